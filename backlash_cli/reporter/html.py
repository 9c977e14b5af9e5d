"""The scan as pages for a browser: one file, or a folder with an overview and a page per loop."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path

from .._version import __version__
from ..record import Record
from ..results import LoopReport, ScanResult
from .figures import POINTS, Figure
from .folder import LoopPart, one_page, write_folder_of
from .loop_page import loop_sections, note_table
from .page import Cell, Section, Table
from .plant_figure import PlantRow, plant_figure
from .safe import shorten
from .words import MARKS, VERDICTS, advice, by_size, excluded, interval, moment, percent, size

DRAWN = 40  # loops in the picture of the plant, and with figures of their own in a single file; a folder has no limit
FINE = 12  # of them with lines as fine as a screen; more share the room, so that a page stays below 3 MB
_TITLE = "Dead band report"


def single_page(result: ScanResult, records: Mapping[str, Record]) -> str:
    """Return one self-contained page; figures for the first 40 loops of the work list, numbers for all."""
    reports = by_size(result.loops)
    points = min(POINTS, POINTS * FINE // max(1, min(len(reports), DRAWN)))
    notes = [] if len(reports) <= DRAWN else [
        f"Figures are shown for the first {DRAWN} loops of the list. For figures of all {len(reports)} loops write a "
        "folder: --format html --output FOLDER."]
    loops = [*_loops(reports[:DRAWN], records, points), *_loops(reports[DRAWN:], {})]
    return one_page(_TITLE, _subtitle(result), loops, lambda links: _overview(result, reports, links, notes))


def write_folder(folder: Path, result: ScanResult, records: Mapping[str, Record],
                 step: Callable[[], None] = lambda: None) -> None:
    """Write index.html and a page per loop, which is loaded when it is opened; `step` is called after each page."""
    reports = by_size(result.loops)
    write_folder_of(folder, _TITLE, _subtitle(result), _loops(reports, records),
                    lambda links: _overview(result, reports, links), result, step)


def _loops(reports: Sequence[LoopReport], records: Mapping[str, Record], points: int = POINTS) -> list[LoopPart]:
    def sections(r: LoopReport) -> list[Section]:
        return loop_sections(r, records.get(r.loop), points)  # one record at a time is in memory

    return [LoopPart(r.loop, MARKS[r.verdict], _brief(r), partial(sections, r)) for r in reports]


def _subtitle(result: ScanResult) -> str:
    starts = [r.start for r in result.loops if r.start is not None]
    ends = [r.end for r in result.loops if r.end is not None]
    span = f", {moment(min(starts))} to {moment(max(ends))}" if starts and ends else ""
    loops = len(result.loops)
    return f"{loops} loop{'s' * (loops != 1)}{span}. Made by backlash {__version__}."


def _size_cell(r: LoopReport) -> Cell:
    d, limit = size(r), excluded(r)
    if d is None:
        return Cell(None, text="" if limit is None else f"below {100 * limit:.2f}")
    return Cell(d, text=f"{100 * d:.2f}")


def _brief(r: LoopReport) -> str:
    d = size(r)
    said = VERDICTS[r.verdict]
    if d is None or r.cluster is None:
        return said
    span = f"{percent(d)} of the output span ({interval(r.cluster.ci95)})"
    return f"{said}, {span}, confidence {percent(r.confidence, 0)}"


def plant_picture(reports: Sequence[LoopReport]) -> Figure:
    """The loops of the work list, worst on top: size with its 95 % interval, or what is excluded; colour by verdict."""
    rows = []
    for r in reports:
        d, below = size(r), excluded(r)
        words = "" if d is not None else VERDICTS[r.verdict] if below is None else f"below {100 * below:.2f} %"
        rows.append(PlantRow(r.loop, VERDICTS[r.verdict], MARKS[r.verdict], d, r.cluster.ci95 if r.cluster else None,
                             below, None if d is None else r.limit_of_detection, words, _brief(r)))
    return plant_figure(rows, "limit of detection")


def _overview(
    result: ScanResult, reports: Sequence[LoopReport], links: Mapping[str, str], notes: Sequence[str] = ()
) -> list[Section]:
    columns = ["Loop", "Verdict", "Size [%]", "95 % interval", "Confidence [%]", "Detections",
               "Advice or reason", "Warnings"]
    rows = []
    for r in reports:
        d = size(r)
        c = r.cluster if d is not None else None
        rows.append([
            Cell(r.loop, text=shorten(r.loop, 80), href=links[r.loop]),
            Cell(VERDICTS[r.verdict], mark=MARKS[r.verdict]),
            _size_cell(r),
            None if c is None else Cell(c.ci95[0], text=f"{100 * c.ci95[0]:.2f} to {100 * c.ci95[1]:.2f}"),
            Cell(r.confidence, text=f"{100 * r.confidence:.0f}"),
            Cell(r.detections, text=f"{r.detections} of {r.half_periods}"),
            shorten(advice(r), 300),
            len(r.warnings),
        ])
    text = [
        "Dead band (play) between controller output and valve, for every loop that was scanned. Sizes are in per cent "
        "of the output span. Select a loop for its evidence.",
        *notes,
    ]
    shown = reports[:DRAWN]
    note = "Worst on top. Point and line: size and its 95 % interval."
    note += " Triangle: a dead band of this size or more is excluded." * any(excluded(r) is not None for r in shown)
    note += (" Upright mark: the limit of detection, the size this record shows with 90 % power."
             * any(size(r) is not None and r.limit_of_detection is not None for r in shown))
    note += f" The first {DRAWN} of {len(reports)} loops are drawn." * (len(reports) > DRAWN)
    sections = [Section("The plant", figure=plant_picture(shown), note=note)] * bool(shown)
    sections += [Section("Overview", text=text, table=Table(columns, rows, filterable=True, choices="Verdict"))]
    if result.failures:
        sections.append(Section("Could not be read or analysed", table=note_table(result.failures)))
    if result.warnings:
        sections.append(Section("Warnings about the input", table=note_table(result.warnings)))
    return sections
