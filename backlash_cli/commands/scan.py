"""backlash scan: from historian exports to one verdict per loop and its nights into a history; check: fit for one?"""

from __future__ import annotations

import contextlib
import gc
import sys
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .. import api
from ..check import LoopCheck, check_loop
from ..engines.local import answers, context_of_processes
from ..errors import BacklashError, UsageError, some
from ..history.store import History
from ..history.unfinished import Unfinished
from ..loaders.clean import Recipe
from ..loaders.grid import DAY
from ..loaders.plant import OpenPlant, open_plant
from ..loaders.sources import Source, find_sources
from ..reporter.check_table import checked
from ..reporter.files import form_of
from ..reporter.safe import counted
from ..reporter.scan_report import check_delivery, draw, met, parse_rules, render, write
from ..reporter.templates import sentence
from ..results import PlantResult, ScanResult
from ..scanning import ScanOptions
from .options import TEXT_OR_JSON, Export, cluster
from .terminal import emit, progress, put, refusal, say, say_failures, say_if_first_run

if TYPE_CHECKING:
    from distributed import Client

MUCH = 1 << 26  # bytes of exports from which on one process is hardly enough
LONG = 1.5 * 86400.0  # seconds; more than this is more than one night
YEAR = 365 * 86400.0  # times below this are counted from the start of the recording, not from 1970


def scan(demo: bool, form: str | None, output: Path | None, table: str, plot: Path | None, history: Path | None,
         resume: bool, fail_on: tuple[str, ...], no_confirm: bool, verbose: bool, quiet: bool, **given: Any) -> int:
    """Find dead band in every loop of an export and say how much, how sure, and what to do."""
    export = Export.of(given)
    if demo == bool(export.inputs):
        raise refusal(UsageError, "demo_or_export", problem="--demo and an export do not fit together" if demo else
                      "nothing to scan: no INPUT")
    rules, form = parse_rules(fail_on), check_delivery(form, output, table)
    wanted = ScanOptions(confirm=not no_confirm, carry=history is not None)
    if history is not None and history.is_file() and history.stat().st_size:  # refused before hours of work
        History(history, say=say).db.close()
    with contextlib.ExitStack() as stack:
        if demo:
            export = stack.enter_context(sample_plant(export, shown=not quiet))
        keep = stack.enter_context(kept(history, (export, wanted), resume=resume))
        with cluster(given) as client:
            job = Job(export, wanted, given["jobs"], client, not quiet, keep)
            result = job.scan()
            if history is not None:
                remember(result, history, job)
        if output is not None:
            with progress("writing", None, shown=job.shown) as step:
                write(result, job.plant, form or "table", output, table, verbose=verbose, step=step)
            if job.shown:
                said = f"; {counted(len(result.warnings), 'warning')} about the input in it" * bool(result.warnings)
                say(f"{counted(len(result.loops), 'loop')} scanned, {form} written to {output}{said}")
        elif form is not None or not quiet:
            colour = sys.stdout.isatty()
            emit("".join(render(result, job.plant, form or "table", table, verbose=verbose, colour=colour)))
        if plot is not None:
            with progress("drawing", len(job.plant), shown=job.shown) as step:
                count = draw(result, job.plant, plot, step)
            if job.shown:
                say(f"{counted(count, 'picture')} written to {plot}")
    status = say_failures("not analysed", lost(result), shown=bool(quiet or output) or form not in (None, "table"))
    if hits := met(rules, result.loops):
        say(f"--fail-on {', '.join(fail_on)}: met by {counted(len(hits), 'loop')}: {some(hits, 10)}")
    return 1 if hits else status


def lost(result: ScanResult) -> list[str]:
    """Return why loops and files were not analysed."""
    errors = [note for r in result.loops if r.verdict == "error" for note in r.reasons[:1]]
    return [note.message for note in (*result.failures, *errors)]


def check(form: str | None, output: Path | None, verbose: bool, **given: Any) -> int:
    """Check data quality and controller settings before trusting a verdict."""
    form, plant, loops = form or form_of(output, TEXT_OR_JSON), Export.of(given).read(compiles=False), []
    with progress("checking", len(plant), stopped="loops were checked; no report was written") as step:
        for r, found in zip(plant, answers(plant.records, check_loop, jobs=1), strict=True):
            loops.append(found if isinstance(found, LoopCheck) else LoopCheck(r.loop, notes=r.notes, failure=found))
            step()
    unread = {str(note.values["loop"]): note for note in plant.failures if note.values.get("loop")}
    loops += [LoopCheck(name, failure=note) for name, note in unread.items()]
    rest = tuple(note for note in plant.failures if not note.values.get("loop"))
    result = PlantResult(tuple(loops), plant.inputs, plant.warnings, rest)
    report, coloured = checked(result), output is None and sys.stdout.isatty()
    put(output, report.json() if form == "json" else report.text(verbose=verbose, colour=coloured),
        f"{counted(len(loops), 'loop')} checked, {form}")
    failed = [f"{loop.loop}: {loop.failure.message.removeprefix(f'{loop.loop}: ')}" for loop in loops if loop.failure]
    return say_failures("not checked", failed + [note.message for note in result.failures],
                        shown=output is not None or form == "json")


@contextlib.contextmanager
def sample_plant(export: Export, *, shown: bool) -> Iterator[Export]:
    """Give the export of the simulated sample plant, made for the time of the block."""
    from tempfile import TemporaryDirectory

    from ..reporter.plant_files import write_plant, write_settings
    from ..simulator import simulate
    from ..simulator.scenario_file import load_scenarios

    if shown:
        say_if_first_run()
        say("demo: twelve simulated loops, three hours at 1 s; `backlash simulate sample-plant --out plant.csv` writes "
            "them and the truth about them")
    with TemporaryDirectory() as folder:
        path, records = Path(folder) / "demo.csv", [simulate(s) for s in load_scenarios("sample-plant")]
        write_plant(path, records, finest=1e-5)
        write_settings(path.with_name("demo.loops.toml"), records)
        yield replace(export, inputs=(path,))


@dataclass
class Job:
    """One scan. client: of the cluster, None for this machine. shown: with progress on a terminal. keep: what is
    finished, for a history; taken_over: so many loops of it."""

    export: Export
    options: ScanOptions
    jobs: int | None = None
    client: Client | None = None
    shown: bool = True
    keep: Unfinished | None = None
    taken_over: int = 0

    @cached_property
    def plant(self) -> OpenPlant:
        """The loops by name, each read again when it is asked for: pictures need the samples."""
        return self._open()

    def scan(self, night: Sequence[Source] | None = None) -> ScanResult:
        """Return the result of all files, or of those of a night."""
        plant = self.plant if night is None else self._open(night)
        gc.freeze()  # neither program nor files hold garbage: looking them through took a tenth of a scan
        if night is None and self.keep is not None:
            self.taken_over = sum(recipe.key in self.keep.known for recipe in plant.recipes)
            if self.keep.resumed and self.shown:
                say(f"{self.taken_over} of {len(plant.recipes)} loops were finished before and are taken over"
                    if self.taken_over else "no finished loop of this scan is left to take over; it begins anew")
        if self.shown and self.options.confirm:  # half periods need no compiled loop
            say_if_first_run()
        go_on = "" if self.keep is None else "; the same command with --resume goes on from there"
        with progress("scanning", len(plant.recipes), shown=self.shown,
                      stopped=f"loops were analysed; no report was written{go_on}") as step:
            return api.scan(plant, self.options, jobs=self.jobs, progress=lambda report: step(), keep=self.keep,
                            client=self.client)

    def _open(self, night: Sequence[Source] | None = None) -> OpenPlant:
        size, inputs = 0, self.export.inputs  # of all files on this machine
        sources = find_sources(inputs) if night is None else night
        with contextlib.suppress(OSError):
            size = sum(one.path.stat().st_size for one in sources if isinstance(one.path, Path))
        if size > MUCH and self.jobs != 1 and self.client is None:
            context_of_processes(compiled=self.options.confirm)  # loads what it needs while the files are opened
        with progress("reading", size or None, shown=self.shown, of_bytes=True) as taken:
            plant = open_plant(inputs, loops=self.export.loops, options=self.export.reading, taken=taken,
                               salt=None if self.keep is None else repr(self.options), sources=sources)
        return plant if night is None else replace(plant, inputs=tuple(str(source.path) for source in night))


@contextlib.contextmanager
def kept(history: Path | None, scan: Iterable[object], *, resume: bool) -> Iterator[Unfinished | None]:
    """Keep what a scan into a history has finished, until the block has ended well. scan: what makes it the same."""
    if history is None:
        if resume:
            raise refusal(UsageError, "resume_without_history", "--resume")
        yield None
        return
    with contextlib.closing(Unfinished(history, scan, resume=resume)) as keep:
        yield keep
        keep.close(ended=True)


def remember(result: ScanResult, history: Path, job: Job) -> None:
    """Store a scan's nights. Several exports of the same loops, joined for the report, are stored one by one."""
    with History(history, create=True, say=say) as store:
        outcome = store.add(*(_one_by_one(result, job) or [result]))
    if outcome["revised"] and any(r.start is not None and r.start < YEAR for r in result.loops):
        say("the export has no calendar date, and replaced the night there: nights are told apart by their times")
    if job.shown:
        say(f"history {history}: {sentence('stored', outcome)}")


def _one_by_one(result: ScanResult, job: Job) -> list[ScanResult]:
    """Return a result per export where the exports are nights of the same loops; nothing where they are not."""
    long = [r.loop for r in result.loops if r.start is not None and r.end is not None and r.end - r.start > LONG]
    if not long:
        return []
    if all(len({item.axis.where for item in r.series.roles.get("pv", ())}) < 2 for r in job.plant.recipes):
        say(f"{some(long, 3)}: the export covers more than a day and enters the history as one night; "
            "scan single days to see wear")
        return []
    found, sources = [], find_sources(job.export.inputs)
    for files in _nights(job.plant.recipes):
        night = [source for source in sources if str(source.path) in files]
        try:
            found.append(job.scan(night))
        except BacklashError as error:
            say(f"this export is no night of the history: {some([one.path.name for one in night], 3)}: {error}")
    return found


def _nights(recipes: Sequence[Recipe]) -> list[set[str]]:
    """Return the files of each night: of every loop one that holds its PV, and what else was recorded meanwhile."""
    nights: defaultdict[tuple[int, int], set[str]] = defaultdict(set)  # day of the first stamp, number in this day
    extent = cache(lambda axis: (axis.first, axis.last()))  # read once: loops share rows, and so do nights
    for roles in (recipe.series.roles for recipe in recipes):
        of_pv, count = {item.axis.where: extent(item.axis) for item in roles.get("pv", ())}, Counter[int]()
        others = [(item.axis.where, *extent(item.axis)) for items in roles.values() for item in items
                  if item.axis.where not in of_pv]
        for file, (first, last) in sorted(of_pv.items(), key=lambda pair: pair[1]):
            count[day := first // DAY] += 1
            nights[day, count[day]] |= {file, *(name for name, begin, end in others if begin <= last and end >= first)}
    return [nights[key] for key in sorted(nights)]
