"""How a scan is carried out: in processes of this machine, or on a cluster."""

from __future__ import annotations

import contextlib
import gc
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import UsageError
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


@dataclass
class Job:
    """One scan. client: of the cluster, None for this machine; absolute: its workers are other machines. shown: with
    progress on a terminal. pictures: `records` will be asked for. keep: what is finished, for a history; taken_over: so
    many loops of it."""

    inputs: Sequence[Path | Remote]
    loops: Path | None
    reading: ReadOptions
    options: ScanOptions
    jobs: int | None = None
    client: Client | None = None
    absolute: bool = False
    shown: bool = True
    pictures: bool = False
    keep: Unfinished | None = None
    taken_over: int = 0

    @cached_property
    def records(self) -> Mapping[str, Record]:
        """The loops by name, each read again when it is asked for: pictures need the samples."""
        from ..loaders.plant import RecordsByName

        return RecordsByName(self._open(self.inputs).recipes)

    def scan(self, inputs: Sequence[Path | Remote] | None = None) -> ScanResult:
        """Return the result of all inputs, or of these."""
        inputs = self.inputs if inputs is None else inputs
        return self._here(inputs) if self.client is None else self._on_cluster(self.client, inputs)

    def _here(self, inputs: Sequence[Path | Remote]) -> ScanResult:
        from ..api import scan
        from ..loaders.plant import RecordsByName

        gc.freeze()  # the program itself holds no garbage: looking it through took a tenth of a scan
        plant = self._open(inputs)
        if self.pictures and inputs is self.inputs:
            self.__dict__["records"] = RecordsByName(plant.recipes)
        total = len(plant.recipes)
        self._tell(inputs, [recipe.key for recipe in plant.recipes])
        if self.shown:
            say_if_first_run()
        with _Counting(total, self.shown, self.keep is not None) as done:
            return scan(plant, self.options, jobs=self.jobs, progress=done, keep=self.keep)

    def _open(self, inputs: Sequence[Path | Remote]) -> OpenPlant:
        from ..api import open_files
        from ..loaders.parts import keyed, marks_of
        from ..loaders.sources import find_sources, size_of

        marks = {} if self.keep is None else marks_of(find_sources(list(inputs)))
        with progress("reading", size_of(inputs), shown=self.shown, of_bytes=True) as taken:
            plant = open_files(list(inputs), loops=self.loops, reading=self.reading, taken=taken)
        if self.keep is None:
            return plant
        return replace(plant, recipes=keyed(plant.recipes, marks, plant.moment, repr(self.options)))

    def _on_cluster(self, client: Client, inputs: Sequence[Path | Remote]) -> ScanResult:
        from ..api import scan_part
        from ..engines.plant import DaskPlant

        with progress("looking at the files", None, shown=self.shown):
            plant = DaskPlant(client, inputs, loops=self.loops, reading=self.reading, absolute=self.absolute)
        salt = repr(self.options)
        if self.keep is not None and self.keep.resumed:
            self._tell(inputs, list(plant.keys(salt).values()))
        with _Counting(len(plant.plan.loops), self.shown, self.keep is not None) as done:
            return plant.scan(partial(scan_part, options=self.options), keep=self.keep, salt=salt, progress=done)

    def _tell(self, inputs: Sequence[Path | Remote], keys: Sequence[str]) -> None:
        """Say how many loops are taken over from the scan that was stopped."""
        if self.keep is None or inputs is not self.inputs:
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


class _Counting:
    """Counts finished loops, on a bar and for the message when the work is stopped."""

    def __init__(self, total: int, shown: bool, kept: bool) -> None:
        self.total, self.done, self.kept = total, 0, kept
        self._bar = progress("scanning", total, shown=shown)

    def __enter__(self) -> _Counting:
        self._step = self._bar.__enter__()
        return self

    def __call__(self, report: LoopReport) -> None:
        self.done += 1
        self._step()

    def __exit__(self, kind: type[BaseException] | None, stop: BaseException | None, trace: object) -> None:
        self._bar.__exit__(None, None, None)
        if isinstance(stop, KeyboardInterrupt):
            stop.add_note(f"{self.done} of {self.total} loops were analysed; no report was written")
            if self.kept:
                stop.add_note("the same command with --resume goes on from there")
