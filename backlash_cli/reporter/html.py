"""The scan as pages for a browser: one file, or a folder with an overview and a page per loop."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

from .._version import __version__
from ..record import Record
from ..results import LoopReport, ScanResult
from .figures import EVIDENCE, OUTPUT, POINTS, QUIET, Figure
from .folder import links_to, write_pages
from .loop_page import loop_sections, note_table
from .page import Cell, Section, Table, drawn, page
from .safe import file_names, picture, shorten
from .words import MARKS, VERDICTS, advice, by_size, excluded, interval, moment, percent, size

DRAWN = 40  # loops in the picture of the plant, and with figures of their own in a single file; a folder has no limit
FINE = 12  # of them with lines as fine as a screen; more share the room, so that a page stays below 3 MB
COLOURS = {"bad": EVIDENCE, "warn": OUTPUT, "good": "#2a9d5c", "quiet": QUIET}
_TITLE = "Dead band report"


def single_page(result: ScanResult, records: Mapping[str, Record]) -> str:
    """Return one self-contained page; figures for the first 40 loops of the work list, numbers for all."""
    reports = by_size(result.loops)
    links = {r.loop: f"#loop-{i}" for i, r in enumerate(reports)}
    points = min(POINTS, POINTS * FINE // max(1, min(len(reports), DRAWN)))
    notes = []
    if len(reports) > DRAWN:
        notes.append(
            f"Figures are shown for the first {DRAWN} loops of the list. For figures of all {len(reports)} loops write "
            "a folder: --format html --output FOLDER."
        )
    loops = [
        Section(
            shorten(r.loop, 120), folded=True, anchor=f"loop-{i}", mark=MARKS[r.verdict], summary=_brief(r),
            parts=drawn(loop_sections(r, records.get(r.loop) if i < DRAWN else None, points)),
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

    The old report is whole until the new one is; see `write_pages`.
    """
    reports = by_size(result.loops)
    names = file_names(r.loop for r in reports)
    mark = hashlib.sha256(repr((__version__, result)).encode("utf-8", "backslashreplace")).hexdigest()[:12]

    def pages() -> Iterator[tuple[str, str]]:
        for r in reports:
            yield names[r.loop], page(
                shorten(r.loop, 120), loop_sections(r, records.get(r.loop)), subtitle=_brief(r),
                plotly_file="plotly.js", back=("../index.html", "All loops"),
            )
            step()

    def index(subfolder: str) -> str:
        return page(_TITLE, _overview(result, reports, links_to(names, subfolder)), subtitle=_subtitle(result),
                    plotly_file=f"{subfolder}/plotly.js")

    write_pages(folder, mark, pages(), index)


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


def plant_figure(reports: Sequence[LoopReport]) -> Figure:
    """The loops of the work list, worst on top: size with its 95 % interval, or what is excluded; colour by verdict."""
    data: list[Figure] = []
    for verdict in dict.fromkeys(r.verdict for r in reports):
        own = [(k, r, size(r), excluded(r)) for k, r in enumerate(reports) if r.verdict is verdict]
        at = [100 * (d or below or 0.0) for _, _, d, below in own]
        said = ["" if d is not None else VERDICTS[verdict] if below is None else f"below {100 * below:.2f} %"
                for _, _, d, below in own]
        spans = [(x, x) if r.cluster is None or words else (100 * r.cluster.ci95[0], 100 * r.cluster.ci95[1])
                 for x, words, (_, r, _, _) in zip(at, said, own, strict=True)]
        colour = COLOURS[MARKS[verdict]]
        data.append({
            "type": "scatter", "mode": "markers+text", "name": f"{VERDICTS[verdict]} ({len(own)})", "x": at,
            "y": [k for k, *_ in own], "text": said, "textposition": "middle right", "cliponaxis": False,
            "showlegend": any(at), "hovertext": [picture(f"{r.loop}: {_brief(r)}", 200) for _, r, _, _ in own],
            "hoverinfo": "text", "marker": {"color": colour, "size": 10, "opacity": [float(x > 0) for x in at],
                                            "symbol": ["triangle-left-open" if words else "circle" for words in said]},
            "error_x": {"type": "data", "symmetric": False, "visible": not all(said), "color": colour, "thickness": 2,
                        "array": [max(high - x, 0.0) for x, (_, high) in zip(at, spans, strict=True)],
                        "arrayminus": [max(x - low, 0.0) for x, (low, _) in zip(at, spans, strict=True)]},
        })
    axis = {"tickvals": [*range(len(reports))], "ticktext": [picture(r.loop, 24) for r in reports], "fixedrange": True,
            "range": [len(reports) - 0.4, -0.6], "zeroline": False}
    return {"data": data, "layout": {
        "xaxis": {"title": {"text": "dead band [% of output span]"}, "rangemode": "tozero"}, "yaxis": axis,
        "hovermode": "closest", "height": 130 + 26 * len(reports)}}


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
    note += f" The first {DRAWN} of {len(reports)} loops are drawn." * (len(reports) > DRAWN)
    sections = [Section("The plant", figure=plant_figure(shown), note=note)] * bool(shown)
    sections += [Section("Overview", text=text, table=Table(columns, rows, filterable=True, choices="Verdict"))]
    if result.failures:
        sections.append(Section("Could not be read or analysed", table=note_table(result.failures)))
    if result.warnings:
        sections.append(Section("Warnings about the input", table=note_table(result.warnings)))
    return sections
