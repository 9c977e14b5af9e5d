"""The table on a terminal: one line per loop, largest dead band first, then what was noticed on the way."""

from __future__ import annotations

import io
from collections import Counter
from collections.abc import Sequence

from rich.console import Console
from rich.table import Table
from rich.text import Text

from ..record import Note
from ..results import UNDECIDED, LoopReport, ScanResult, Verdict
from .plain_table import GAP, Column, lines
from .safe import clip, terminal
from .words import MARKS, VERDICTS, advice, by_size, excluded, size

WIDTH = 100
_COLOURS = {"bad": "bold red", "warn": "yellow", "good": "green", "quiet": "dim"}
_LISTED = 12  # notes shown before "and N more"


def to_text(result: ScanResult, *, verbose: bool = False, colour: bool = False, width: int = WIDTH) -> str:
    """Return the report as text of at most `width` columns; `verbose` adds every reason and warning of every loop."""
    out = io.StringIO()
    console = Console(
        file=out, width=min(width, WIDTH), force_terminal=colour, color_system="standard" if colour else None,
        highlight=False, markup=False, emoji=False, legacy_windows=False,
    )
    reports = by_size(result.loops)
    if colour:
        console.print(_coloured(reports))
    else:
        out.writelines(f"{line}\n" for line in lines(COLUMNS, [_cells(r) for r in reports], min(width, WIDTH)))
    console.print(_summary(reports))
    for report in reports:
        if verbose:
            _details(console, report)
    if not verbose:
        _warnings(console, reports)
    _notes(console, "Warnings about the input:", result.warnings)
    _notes(console, "Could not be read or analysed:", result.failures)
    return "\n".join(line.rstrip() for line in out.getvalue().splitlines()) + "\n"


COLUMNS = (
    Column("Loop", least=6, most=20), Column("Verdict"), Column("Size", right=True), Column("95 %", right=True),
    Column("Sure", right=True), Column("Found", right=True), Column("Advice or reason"),
)


def _cells(report: LoopReport) -> list[str]:
    d = size(report)
    low, high = report.cluster.ci95 if d is not None and report.cluster is not None else (0.0, 0.0)
    quiet = report.verdict in (Verdict.ERROR, Verdict.INSUFFICIENT_DATA)
    return [
        terminal(report.loop, 40),
        VERDICTS[report.verdict],
        _size(report),
        "" if d is None else f"{100 * low:.2f}–{100 * high:.2f}",
        "" if quiet else f"{100 * report.confidence:.0f} %",
        "" if quiet else f"{report.detections} of {report.half_periods}",
        clip(advice(report), 120),
    ]


def _coloured(reports: Sequence[LoopReport]) -> Table:
    table = Table(box=None, pad_edge=False, header_style="bold", padding=(0, GAP, 0, 0))
    for column in COLUMNS[:-1]:
        table.add_column(column.title, justify="right" if column.right else "left", min_width=column.least,
                         max_width=column.most, no_wrap=True, overflow="ellipsis")
    table.add_column(COLUMNS[-1].title, ratio=1, overflow="fold")
    for report in reports:
        cells = [Text(cell) for cell in _cells(report)]
        cells[1].stylize(_COLOURS[MARKS[report.verdict]])
        table.add_row(*cells)
    return table


def _size(report: LoopReport) -> str:
    d, limit = size(report), excluded(report)
    if d is not None:
        return f"{100 * d:.2f}"
    return "" if limit is None else f"<{100 * limit:.2f}"


def _summary(reports: Sequence[LoopReport]) -> str:
    counts = Counter(r.verdict for r in reports)
    said = ", ".join(f"{counts[v]} {words}" for v, words in VERDICTS.items() if counts[v])
    undecided = sum(r.verdict in UNDECIDED for r in reports)
    plan = f" What would decide the {undecided} undecided: backlash plan." * bool(undecided)
    return f"\n{len(reports)} loop{'s' * (len(reports) != 1)}: {said}. Sizes in % of the output span.{plan}"


def _details(console: Console, report: LoopReport) -> None:
    console.print(Text(f"\n{terminal(report.loop, 60)}: {VERDICTS[report.verdict]}", style="bold"))
    for word, notes in (("reason", report.reasons), ("warning", report.warnings)):
        for note in notes:
            console.print(f"  {word} {note.code}: {terminal(note.message)}")
    if report.rejected:
        refused = ", ".join(f"{n} {code}" for code, n in report.rejected.items())
        console.print(f"  half periods not used: {refused}")


def _warnings(console: Console, reports: Sequence[LoopReport]) -> None:
    """One line per kind of warning: how many loops have it, and the first one's words."""
    kinds: dict[str, list[tuple[str, Note]]] = {}
    for report in reports:
        for note in report.warnings:
            kinds.setdefault(note.code, []).append((report.loop, note))
    if not kinds:
        return
    console.print("\nWarnings (--verbose lists all of them):")
    for code, found in kinds.items():
        loop, note = found[0]
        loops = len({name for name, _ in found})
        more = f" (and {loops - 1} more loop{'s' * (loops > 2)})" if loops > 1 else ""
        console.print(f"  {code}, {terminal(loop, 30)}{more}: {clip(note.message, 300)}")


def _notes(console: Console, title: str, notes: Sequence[Note]) -> None:
    if not notes:
        return
    console.print(f"\n{title}")
    for note in notes[:_LISTED]:
        console.print(f"  {note.code}: {clip(note.message, 300)}")
    if len(notes) > _LISTED:
        console.print(f"  and {len(notes) - _LISTED} more; --format json lists all of them")
