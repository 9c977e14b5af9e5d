"""The results of a plant's parts put together: the report that one reading of the whole plant gives."""

from __future__ import annotations

from collections.abc import Iterable

from ..errors import InputError, LoopError
from ..loaders.plant import SOURCE, nothing_read
from ..loaders.shares import PlantPlan
from ..loaders.since import nothing_since, since_notes
from ..record import Note
from ..results import LoopReport, ScanResult, Verdict


def combine(plan: PlantPlan, results: Iterable[ScanResult]) -> ScanResult:
    """Return the result of the whole.

    Raises BacklashError where reading the whole would: no loop, or no file, could be read.
    """
    results = list(results)
    found = {report.loop: report for result in results for report in result.loops}
    without = [name for name, report in found.items() if _code(report) == "nothing_since"]
    for name in without:
        del found[name]
    failures = _files_in_order(plan, [note for result in results for note in result.failures])
    broken = {str(note.values["file"]) for note in failures if "file" in note.values}
    for name, files in plan.loops.items():
        if name not in found and name not in without and not {str(plan.sources[k].path) for k in files} <= broken:
            note = Note("lost", f"{name}: its part of the scan gave no result", {"loop": name})
            found[name] = LoopReport(name, Verdict.ERROR, (note,))
    reports = [found[name] for name in sorted(found)]
    refused = [report for report in reports if is_refused(report)]
    if not found and without and plan.reading.since is not None and plan.moment is not None:
        raise nothing_since(plan.reading.since, plan.moment, plan.last)
    if not found:
        first = InputError(failures[0].message) if failures else None
        raise nothing_read(len(plan.sources), first)
    if len(refused) == len(reports):
        first_note = refused[0].reasons[0]
        many = f"no loop could be read; {first_note.message}"
        raise LoopError(many if len(refused) > 1 else first_note.message, code=first_note.code)
    since: list[Note] = []
    if plan.reading.since is not None and plan.moment is not None:
        since = since_notes(plan.reading.since, plan.moment, without, len(plan.loops))
    of_files = _warnings_in_order(plan, [note for result in results for note in result.warnings])
    warnings = (*plan.notes, *of_files, *plan.chosen, *since, *plan.unmatched)
    reports = [report for report in reports if not is_refused(report)]
    return ScanResult((*reports, *refused), plan.given, warnings, tuple(failures))


def is_refused(report: LoopReport) -> bool:
    """Whether a loop could not even be read."""
    return report.verdict is Verdict.ERROR and any(note.values.get("loop") == report.loop for note in report.reasons)


def _code(report: LoopReport) -> str:
    return report.reasons[0].code if is_refused(report) else ""


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
