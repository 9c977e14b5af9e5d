"""The public functions over whole plants: read exports, scan their loops, compare and explain single loops."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING

from .engines.local import analyse
from .record import Note, Record
from .results import LoopReport, ScanResult, Verdict
from .scan import ScanOptions

if TYPE_CHECKING:
    from .loaders import Plant


def scan(
    plant: Plant | Record | Iterable[Record],
    options: ScanOptions | None = None,
    *,
    jobs: int | None = None,
    progress: Callable[[LoopReport], None] | None = None,
) -> ScanResult:
    """Analyse every loop and return one report per loop, in the order of the plant.

    plant: what `read` returns, one Record, or several. jobs: number of processes; None chooses, 1 stays in this
    process. progress: called after each loop. A loop that cannot be analysed is reported with verdict `error`.
    """
    records = (plant,) if isinstance(plant, Record) else tuple(plant)
    warnings: tuple[Note, ...] = getattr(plant, "warnings", ())
    failures: tuple[Note, ...] = getattr(plant, "failures", ())
    inputs: tuple[str, ...] = getattr(plant, "inputs", ())
    reports = []
    for report in analyse(records, options, jobs=jobs):
        reports.append(report)
        if progress is not None:
            progress(report)
    known = {report.loop for report in reports}
    refused = [_refused(note) for note in failures if _loop(note) and _loop(note) not in known]
    others = tuple(note for note in failures if not _loop(note) or _loop(note) in known)
    return ScanResult((*reports, *refused), inputs, warnings, others)


def _loop(note: Note) -> str:
    """The loop that a loader's failure is about, empty if it is about a file."""
    return str(note.values.get("loop", ""))


def _refused(note: Note) -> LoopReport:
    return LoopReport(_loop(note), Verdict.ERROR, (note,))
