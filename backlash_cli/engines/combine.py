"""The results of a plant's parts put together: the report that one reading of the whole plant gives."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass

from ..errors import InputError, LoopError
from ..loaders.choose import nothing_since, since_notes
from ..loaders.parts import PlantPlan
from ..loaders.plant import SOURCE, nothing_read
from ..record import Note
from ..results import LoopReport, ScanResult, Verdict


@dataclass(frozen=True)
class Whole:
    """What is to be said of a plant. refused: loops that could not be read. failures: files that could not."""

    refused: dict[str, Note]
    warnings: tuple[Note, ...]
    failures: tuple[Note, ...]


def combine(plan: PlantPlan, results: Iterable[ScanResult]) -> ScanResult:
    """Return the result of the whole.

    Raises BacklashError where reading the whole would: no loop, or no file, could be read.
    """
    results = list(results)
    found = {report.loop: report for result in results for report in result.loops}
    refused = {name: report.reasons[0] for name, report in found.items() if is_refused(report)}
    whole = whole_of(plan, found.keys() - refused.keys(), refused, (n for r in results for n in r.warnings),
                     (n for r in results for n in r.failures))
    reports = [found[name] for name in sorted(found) if name not in refused]
    unread = [LoopReport(name, Verdict.ERROR, (whole.refused[name],)) for name in sorted(whole.refused)]
    return ScanResult((*reports, *unread), plan.given, whole.warnings, whole.failures)


def whole_of(
    plan: PlantPlan, done: Collection[str], refused: Mapping[str, Note], warnings: Iterable[Note],
    failures: Iterable[Note],
) -> Whole:
    """Return what is to be said of a plant, from what its parts said. done: loops that could be read. refused: loops
    that could not. Raises BacklashError where reading the whole would: no loop, or no file, could be read."""
    without = [name for name, note in refused.items() if note.code == "nothing_since"]
    unread = {name: note for name, note in refused.items() if name not in without}
    files = _files_in_order(plan, failures)
    broken = {str(note.values["file"]) for note in files if "file" in note.values}
    for name, numbers in plan.loops.items():
        known = name in done or name in refused
        if not known and not {str(plan.sources[k].path) for k in numbers} <= broken:
            unread[name] = Note("lost", f"{name}: its part of the work gave no result", {"loop": name})
    if not done and not unread and without and plan.reading.since is not None and plan.moment is not None:
        raise nothing_since(plan.reading.since, plan.moment, plan.last)
    if not done and not unread:
        raise nothing_read(len(plan.sources), InputError(files[0].message) if files else None)
    if not done:
        first = unread[min(unread)]
        many = f"no loop could be read; {first.message}"
        raise LoopError(many if len(unread) > 1 else first.message, code=first.code)
    since: list[Note] = []
    if plan.reading.since is not None and plan.moment is not None:
        since = since_notes(plan.reading.since, plan.moment, without, len(plan.loops))
    of_files = _warnings_in_order(plan, warnings)
    return Whole(unread, (*plan.notes, *of_files, *plan.chosen, *since, *plan.unmatched), tuple(files))


def is_refused(report: LoopReport) -> bool:
    """Whether a loop could not even be read."""
    return report.verdict is Verdict.ERROR and any(note.values.get("loop") == report.loop for note in report.reasons)


def _files_in_order(plan: PlantPlan, more: Iterable[Note]) -> list[Note]:
    """Failures of files, each once, in the order of the files."""
    place = {str(source.path): k for k, source in enumerate(plan.sources)}
    unique: dict[str, Note] = {}
    for note in (*plan.failures, *more):
        unique.setdefault(str(note.values.get("file", note.message)), note)
    return sorted(unique.values(), key=lambda note: place.get(str(note.values.get("file", "")), len(place)))


def _warnings_in_order(plan: PlantPlan, notes: Iterable[Note]) -> list[Note]:
    """Notes of files, each once, in the order of the files."""
    place = {str(source.path): k for k, source in enumerate(plan.sources)}
    unique: dict[tuple[int, str, str], Note] = {}
    for note in notes:
        values = {key: value for key, value in note.values.items() if key != SOURCE}
        at = place.get(str(note.values.get(SOURCE, "")), len(place))
        unique.setdefault((at, note.code, note.message), Note(note.code, note.message, values))
    return [unique[key] for key in sorted(unique, key=lambda key: key[0])]
