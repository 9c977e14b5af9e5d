"""How a scan is carried out, in processes of this machine or on a cluster, and how its nights enter a history."""

from __future__ import annotations

import contextlib
import gc
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import UsageError
from ..results import ScanResult
from .terminal import progress, say, say_if_first_run

if TYPE_CHECKING:
    from distributed import Client

    from ..history.unfinished import Unfinished
    from ..loaders import ReadOptions
    from ..loaders.plant import OpenPlant
    from ..loaders.remote import Remote
    from ..record import Record
    from ..results import LoopReport, ScanResult
    from ..scanning import ScanOptions

LONG = 1.5 * 86400.0  # seconds; more than this is more than one night
YEAR = 365 * 86400.0  # times below this are counted from the start of the recording, not from 1970
_STAMP = re.compile(  # a date, perhaps with a time, at the end of a file's name
    r"[ _.-]+(19|20)\d\d[-_.]?(0[1-9]|1[0-2])[-_.]?(0[1-9]|[12]\d|3[01])([ _T.-]?\d\d[-_:]?\d\d([-_:]?\d\d)?)?$"
)


@dataclass
class Job:
    """One scan. client: of the cluster, None for this machine. shown: with progress on a terminal. keep: what is
    finished, for a history; taken_over: so many loops of it. files: of each loop, where its measurement stands."""

    inputs: Sequence[Path | Remote]
    loops: Path | None
    reading: ReadOptions
    options: ScanOptions
    jobs: int | None = None
    client: Client | None = None
    shown: bool = True
    keep: Unfinished | None = None
    taken_over: int = 0
    files: dict[str, set[str]] = field(default_factory=dict)

    @cached_property
    def plant(self) -> OpenPlant:
        return self._open(self.inputs)

    @property
    def records(self) -> Mapping[str, Record]:
        """The loops by name, each read again when it is asked for: pictures need the samples."""
        return self.plant

    def scan(self, inputs: Sequence[Path | Remote] | None = None) -> ScanResult:
        """Return the result of all inputs, or of these."""
        from ..api import scan

        gc.freeze()  # the program itself holds no garbage: looking it through took a tenth of a scan
        plant = self.plant if inputs is None else self._open(inputs)
        if inputs is None:
            self.files = {r.loop: {item.where for item in r.series.roles.get("pv", ())} for r in plant.recipes}
            self._tell([recipe.key for recipe in plant.recipes])
        if self.shown:
            say_if_first_run()
        with _counting(len(plant.recipes), shown=self.shown, kept=self.keep is not None) as done:
            return scan(plant, self.options, jobs=self.jobs, progress=done, keep=self.keep, client=self.client)

    def _open(self, inputs: Sequence[Path | Remote]) -> OpenPlant:
        from ..loaders.plant import open_plant
        from ..loaders.sources import size_of

        with progress("reading", size_of(inputs), shown=self.shown, of_bytes=True) as taken:
            return open_plant(list(inputs), loops=self.loops, options=self.reading, taken=taken,
                              salt=None if self.keep is None else repr(self.options))

    def _tell(self, keys: Sequence[str]) -> None:
        """Say how many loops are taken over from the scan that was stopped."""
        if self.keep is None:
            return
        self.taken_over = sum(key in self.keep.known for key in keys)
        if self.keep.resumed and self.shown:
            say(f"{self.taken_over} of {len(keys)} loops were finished before and are taken over" if self.taken_over
                else "no finished loop of this scan is left to take over; it begins anew")


@contextlib.contextmanager
def kept(history: Path | None, scan: Iterable[object], *, resume: bool) -> Iterator[Unfinished | None]:
    """Keep what a scan into a history has finished, until the block has ended well. scan: what makes it the same."""
    if resume and history is None:
        raise UsageError("--resume goes on with a scan into a history", where="--resume",
                         remedy="name the file with --history, as the scan that was stopped did")
    if history is None:
        yield None
        return
    from ..history.unfinished import Unfinished

    keep = Unfinished(history, scan, resume=resume)
    try:
        yield keep
        keep.remove()
    finally:
        keep.close()


@contextlib.contextmanager
def _counting(total: int, *, shown: bool, kept: bool) -> Iterator[Callable[[LoopReport], None]]:
    """Count finished loops, on a bar and for the message when the work is stopped."""
    done = 0

    def one_more(report: LoopReport) -> None:
        nonlocal done
        done += 1
        step()

    try:
        with progress("scanning", total, shown=shown) as step:
            yield one_more
    except KeyboardInterrupt as stop:
        stop.add_note(f"{done} of {total} loops were analysed; no report was written")
        if kept:
            stop.add_note("the same command with --resume goes on from there")
        raise


def remember(result: ScanResult, history: Path, job: Job) -> None:
    """Store a scan's nights. Several exports of the same loops, joined for the report, are stored one by one."""
    from ..history.store import History

    with History(history, create=True, say=say) as store:
        parts = _one_by_one(result, job) or [result]
        outcome = store.add_all([undated(part) for part in parts])
    if outcome.revised and any(r.start is not None and r.start < YEAR for r in result.loops):
        say("the export has no calendar date, and so replaced the night that was there: nights are told apart by their "
            "times")
    if job.shown:
        say(f"history {history}: {outcome.sentence()}")


def _one_by_one(result: ScanResult, job: Job) -> list[ScanResult]:
    """Return a result per export where the exports are nights of the same loops; nothing where they are not."""
    from ..errors import BacklashError
    from ..loaders.sources import find_sources

    long = [r.loop for r in result.loops if r.start is not None and r.end is not None and r.end - r.start > LONG]
    if not long:
        return []
    if max(map(len, job.files.values()), default=0) < 2:
        say(f"{', '.join(long[:3])}: the export covers more than a day and enters the history as one night; "
            "scan single days to see wear")
        return []
    found = []
    for source in find_sources(list(job.inputs)):
        try:
            found.append(job.scan([source.path]))
        except BacklashError as error:
            say(f"this export is no night of the history: {source.path.name}: {error}")
    return found


def undated(result: ScanResult) -> ScanResult:
    """Return the result with the date taken off loop names that come from dated files (FIC101_20260302_2155.csv)."""
    return replace(result, loops=tuple(replace(r, loop=_STAMP.sub("", r.loop) or r.loop) for r in result.loops))
