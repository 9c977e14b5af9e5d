"""A whole plant on a Dask cluster: the files are surveyed, the loops dealt out, the parts put together again."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from ..errors import BacklashError
from ..history.unfinished import Unfinished
from ..loaders.options import ReadOptions, is_age
from ..loaders.parts import Part, PlantPlan, Survey, alone, cut_parts, keyed, make_plan, sources_of, survey_all
from ..loaders.plant import SOURCE, recipes_of
from ..loaders.sources import Source
from ..record import Note
from ..results import LoopReport, ScanResult, Verdict
from ..settings import Metadata
from .combine import Whole, combine, whole_of
from .dask import on_cluster

if TYPE_CHECKING:
    from distributed import Client

Result = TypeVar("Result")
Given = Sequence[str | PathLike[str]]
FILES = 32  # looked at by one worker at a time


class DaskPlant:
    """A plant on a cluster. absolute: the workers are other machines, with other working folders.

    Raises BacklashError as reading the plant here would, or when the workers do not see the files.
    """

    def __init__(self, client: Client, inputs: Given, *, loops: str | PathLike[str] | Metadata | None,
                 reading: ReadOptions, absolute: bool) -> None:
        self.client = client
        sources = sources_of(inputs, absolute=absolute)
        self.plan: PlantPlan = make_plan(inputs, sources, self._surveys(sources, reading), loops=loops, reading=reading)

    def _surveys(self, sources: Sequence[Source], reading: ReadOptions) -> list[Survey]:
        bare = [alone(source) for source in sources]
        groups = [bare[k : k + FILES] for k in range(0, len(bare), FILES)]
        end = reading.since is not None and is_age(reading.since)
        look = partial(survey_all, options=reading, end=end)
        futures = self.client.map(look, groups, pure=False, retries=2)
        try:
            found = [survey for group in self.client.gather(futures) for survey in group]
        except Exception as error:
            said = str(error).strip().split("\n")[0][:200]
            raise BacklashError(f"the workers could not look at the files: {type(error).__name__}: {said}",
                                where="--engine dask", remedy="see the logs of the workers") from None
        unseen = [s.source for s in found if s.failure is not None and _is_there(s.source)]
        if unseen and len(unseen) == len(found) and all("no such file" in str(s.failure) for s in found):
            raise BacklashError("the workers do not see this file, which is there on this machine",
                                where=str(unseen[0].path), code="not_shared",
                                remedy="put the data where every machine finds them under the same name: a network "
                                       "drive, or s3://, abfs://, gs://")
        return found

    def each(self, work: Callable[[Part], Result], lost: Callable[[str, Note], Result],
             loops: Iterable[str] | None = None, most: int | None = None) -> Iterator[Result]:
        """Yield the result of `work` for every part, as they come; loops: only these; most: loops of a part."""
        workers = sum(self.client.nthreads().values())
        return on_cluster(self.client, cut_parts(self.plan, workers, loops, most), work, lost)

    def whole(self, done: Iterable[str], warnings: Iterable[Note], failures: Iterable[Note]) -> Whole:
        """Return what is to be said of the plant, from what the parts said. done: loops that could be read. failures:
        files and loops that could not. Raises BacklashError where reading the plant here would."""
        failures = list(failures)
        refused = {str(note.values["loop"]): note for note in failures if "loop" in note.values}
        return whole_of(self.plan, set(done), refused, warnings, [n for n in failures if "loop" not in n.values])

    def scan(self, work: Callable[[Part], ScanResult], *, keep: Unfinished | None = None, salt: str = "",
             progress: Callable[[LoopReport], None] | None = None) -> ScanResult:
        """Return the result of the whole plant. keep: takes in the report of each loop as it comes; loops that it knows
        are not computed again. salt: what a report depends on beside the data and how they are read."""
        keys = {} if keep is None else self.keys(salt)
        kept = {name: keep.known[key] for name, key in keys.items() if key in keep.known} if keep is not None else {}
        kept = {name: one for name, one in kept.items() if one.notes is not None}
        results = [ScanResult((one.report,), warnings=one.notes or (), failures=one.failures) for one in kept.values()]
        for one in kept.values() if progress is not None else ():
            progress(one.report)  # type: ignore[misc]
        missing = [name for name in self.plan.loops if name not in kept]
        for result in self.each(work, _lost, missing):
            results.append(result)
            for report in result.loops:
                if keep is not None and report.loop in keys:
                    keep.add(keys[report.loop], report, *self._said(report.loop, result))
                if progress is not None:
                    progress(report)
        return combine(self.plan, results)

    def keys(self, salt: str) -> dict[str, str]:
        """Return the keys of all loops, by which finished reports are known again."""
        plan = self.plan
        recipes = recipes_of(plan.series, plan.metadata, plan.reading)
        marks = {str(s.source.path): s.mark for s in plan.surveys}
        return {recipe.loop: recipe.key for recipe in keyed(recipes, marks, plan.moment, salt)}

    def _said(self, loop: str, result: ScanResult) -> tuple[tuple[Note, ...], tuple[Note, ...]]:
        """What was said of the files of a loop when its part was read: remarks, and those that could not be read."""
        files = {str(self.plan.sources[number].path) for number in self.plan.loops[loop]}
        return (tuple(note for note in result.warnings if note.values.get(SOURCE) in files),
                tuple(note for note in result.failures if note.values.get("file") in files))


def _lost(loop: str, reason: Note) -> ScanResult:
    return ScanResult((LoopReport(loop, Verdict.ERROR, (Note(reason.code, reason.message),)),))


def _is_there(source: Source) -> bool:
    return isinstance(source.path, Path) and source.path.is_file()
