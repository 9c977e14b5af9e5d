"""The table on a terminal: one line per loop, largest dead band first, then what was noticed on the way."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from ..record import Note
from ..results import UNDECIDED, LoopReport, ScanResult, Verdict
from .console import WIDTH, Screen
from .safe import clip, terminal
from .words import MARKS, VERDICTS, advice, by_size, excluded, size

_COLOURS = {"bad": "bold red", "warn": "yellow", "good": "green", "quiet": "dim"}
_LISTED = 12  # notes shown before "and N more"
COLUMNS = ("Loop", "Verdict", ">Size", ">95 %", ">Sure", ">Found", "Advice or reason")


def to_text(result: ScanResult, *, verbose: bool = False, colour: bool = False, width: int = WIDTH) -> str:
    """Return the report as text of at most `width` columns; `verbose` adds every reason and warning of every loop."""
    screen = Screen(colour=colour, width=min(width, WIDTH))
    reports = by_size(result.loops)
    screen.table(COLUMNS, map(_cells, reports), most=20,
                 styles=[["", _COLOURS[MARKS[r.verdict]], *[""] * 5] for r in reports])
    counts = Counter(r.verdict for r in reports)
    said = ", ".join(f"{counts[v]} {words}" for v, words in VERDICTS.items() if counts[v])
    undecided = sum(r.verdict in UNDECIDED for r in reports)
    plan = f" What would decide the {undecided} undecided: backlash plan." * bool(undecided)
    screen.say(f"\n{len(reports)} loop{'s' * (len(reports) != 1)}: {said}. Sizes in % of the output span.{plan}")
    for report in reports if verbose else ():
        _details(screen, report)
    if not verbose:
        _warnings(screen, reports)
    screen.notes("Warnings about the input:", result.warnings, _LISTED)
    screen.notes("Could not be read or analysed:", result.failures, _LISTED)
    return screen.text()


def _cells(report: LoopReport) -> list[str]:
    d, limit = size(report), excluded(report)
    low, high = report.cluster.ci95 if d is not None and report.cluster is not None else (0.0, 0.0)
    quiet = report.verdict in (Verdict.ERROR, Verdict.INSUFFICIENT_DATA)
    return [
        terminal(report.loop, 40), VERDICTS[report.verdict],
        f"{100 * d:.2f}" if d is not None else "" if limit is None else f"<{100 * limit:.2f}",
        "" if d is None else f"{100 * low:.2f}–{100 * high:.2f}", "" if quiet else f"{100 * report.confidence:.0f} %",
        "" if quiet else f"{report.detections} of {report.half_periods}", clip(advice(report), 120),
    ]


def _details(screen: Screen, report: LoopReport) -> None:
    screen.say(f"\n{terminal(report.loop, 60)}: {VERDICTS[report.verdict]}", style="bold")
    for word, notes in (("reason", report.reasons), ("warning", report.warnings)):
        for note in notes:
            screen.say(f"{word} {note.code}: {terminal(note.message)}", indent=2)
    if report.rejected:
        refused = ", ".join(f"{n} {code}" for code, n in report.rejected.items())
        screen.say(f"half periods not used: {refused}", indent=2)


def _warnings(screen: Screen, reports: Sequence[LoopReport]) -> None:
    """One line per kind of warning: how many loops have it, and the first one's words."""
    kinds: dict[str, dict[str, Note]] = {}
    for report in reports:
        for note in report.warnings:
            kinds.setdefault(note.code, {}).setdefault(report.loop, note)
    if kinds:
        screen.say("\nWarnings (--verbose lists all of them):")
    for code, found in kinds.items():
        (loop, note), others = next(iter(found.items())), len(found) - 1
        more = f" (and {others} more loop{'s' * (others > 1)})" if others else ""
        screen.say(f"{code}, {terminal(loop, 30)}{more}: {clip(note.message, 300)}", indent=2)
