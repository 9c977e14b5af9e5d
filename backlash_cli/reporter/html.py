"""The scan as pages for a browser: one file, or a folder with an overview and a page per loop."""

from __future__ import annotations

import contextlib
import hashlib
import re
import shutil
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from .._version import __version__
from ..errors import BacklashError
from ..record import Record
from ..results import LoopReport, ScanResult
from .files import write_text
from .loop_page import loop_sections, note_table
from .page import Cell, Section, Table, page, plotly_script
from .safe import file_names, shorten
from .words import MARKS, VERDICTS, advice, by_size, interval, moment, percent, size

DRAWN = 60  # loops with figures in a single file; a folder has no limit
_PAGES = re.compile(r"loops-[0-9a-f]{12}")
_TITLE = "Dead band report"


def single_page(result: ScanResult, records: Mapping[str, Record]) -> str:
    """Return one self-contained page; figures for the first 60 loops of the work list, numbers for all."""
    reports = by_size(result.loops)
    links = {r.loop: f"#loop-{i}" for i, r in enumerate(reports)}
    notes = []
    if len(reports) > DRAWN:
        notes.append(
            f"Figures are shown for the first {DRAWN} loops of the list. For figures of all {len(reports)} loops write "
            "a folder: --format html --output FOLDER."
        )
    loops = [
        Section(
            shorten(r.loop, 120), folded=True, anchor=f"loop-{i}", mark=MARKS[r.verdict], summary=_brief(r),
            parts=loop_sections(r, records.get(r.loop) if i < DRAWN else None),
        )
        for i, r in enumerate(reports)
    ]
    sections = [*_overview(result, reports, links, notes), Section("Loops", parts=loops)]
    return page(_TITLE, sections, subtitle=_subtitle(result))


def write_folder(
    folder: Path,
    result: ScanResult,
    records: Mapping[str, Record],
    step: Callable[[], None] = lambda: None,
) -> None:
    """Write index.html and a page per loop, which is loaded when it is opened; `step` is called after each page.

    The pages of a run stand in their own subfolder and index.html is replaced last, in one step: until then the old
    report is whole. Pages of older runs, except those of the report just replaced, are removed at the end.
    """
    reports = by_size(result.loops)
    names = file_names(r.loop for r in reports)
    mark = hashlib.sha256(repr((__version__, result)).encode("utf-8", "backslashreplace")).hexdigest()[:12]
    pages = folder / f"loops-{mark}"
    previous = _pages_of(folder / "index.html")
    try:
        pages.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BacklashError(
            f"cannot make the folder: {error.strerror}", where=str(folder), remedy="choose another with --output",
            code="cannot_write",
        ) from error
    try:
        write_text(pages / "plotly.js", plotly_script())
        for r in reports:
            body = page(
                shorten(r.loop, 120), loop_sections(r, records.get(r.loop)), subtitle=_brief(r),
                plotly_file="plotly.js", back=("../index.html", "All loops"),
            )
            write_text(pages / f"{names[r.loop]}.html", body)
            step()
        links = {loop: f"{pages.name}/{name}.html" for loop, name in names.items()}
        write_text(folder / "index.html", page(_TITLE, _overview(result, reports, links), subtitle=_subtitle(result)))
    except BaseException:
        if pages.name != previous:
            shutil.rmtree(pages, ignore_errors=True)
        raise
    for old in folder.iterdir():
        if _PAGES.fullmatch(old.name) and old.name not in (pages.name, previous):
            shutil.rmtree(old, ignore_errors=True)


def _pages_of(index: Path) -> str:
    """Name of the subfolder that the present index.html points to, empty if there is none."""
    with contextlib.suppress(OSError, ValueError):
        found = _PAGES.search(index.read_text("utf-8"))
        return found.group() if found else ""
    return ""


def _subtitle(result: ScanResult) -> str:
    starts = [r.start for r in result.loops if r.start is not None]
    ends = [r.end for r in result.loops if r.end is not None]
    span = f", {moment(min(starts))} to {moment(max(ends))}" if starts and ends else ""
    loops = len(result.loops)
    return f"{loops} loop{'s' * (loops != 1)}{span}. Made by backlash {__version__}."


def _brief(r: LoopReport) -> str:
    d = size(r)
    said = VERDICTS[r.verdict]
    if d is None or r.cluster is None:
        return said
    span = f"{percent(d)} of the output span ({interval(r.cluster.ci95)})"
    return f"{said}, {span}, confidence {percent(r.confidence, 0)}"


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
            None if d is None else Cell(d, text=f"{100 * d:.2f}"),
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
    sections = [Section("Overview", text=text, table=Table(columns, rows, filterable=True, choices="Verdict"))]
    if result.failures:
        sections.append(Section("Could not be read or analysed", table=note_table(result.failures)))
    if result.warnings:
        sections.append(Section("Warnings about the input", table=note_table(result.warnings)))
    return sections
