"""Comparison and explanation on a terminal: the answer first, then the numbers behind it, in plain words."""

from __future__ import annotations

import io
from collections.abc import Sequence

from rich.console import Console
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from ..record import Note
from ..results import Comparison, Explanation, Region
from .explain_words import (
    candidate_verdict,
    error_size,
    fails,
    ladder,
    look_alike_words,
    plain_name,
    rest_words,
    share,
    span_words,
    still_holds,
    sureness,
    verdict,
)
from .parameter_words import meaning, numbers
from .safe import terminal

WIDTH = 100
REGIONS = 8  # rows of the table of regions, unless all are asked for
CANDIDATES = 6


def comparison_text(c: Comparison, *, verbose: bool = False, colour: bool = False, width: int = WIDTH) -> str:
    """Return how well the model fits, what is the best to hope for, and where it fails, worst first."""
    console, out = _console(colour, width)
    _head(console, c, "model against measurement")
    table = _table("", "fit", "hold-out", "")
    if not c.fitted:
        names = ", ".join(plain_name(e.effect) for e in c.effects)
        table.add_row("this model", error_size(c.fitness.rmse), error_size(c.fitness.rmse_holdout),
                      f"with {names}" if names else "gain, lag and offset of the model file")
    table.add_row("plain model", error_size(c.baseline.rmse), error_size(c.baseline.rmse_holdout),
                  "gain, one lag and offset" + ("; this is the model compared" if c.fitted else ""))
    table.add_row("noise floor", error_size(c.noise_floor), "", "no model can do better than the measurement noise")
    console.print(table)
    if still_holds(c):
        _say(console, "\n" + still_holds(c))
        for note in c.reasons:
            _say(console, "- " + terminal(note.message, 400), indent=2)
    if c.unexplained is not None:
        _say(console, f"\nOf the squared error above the noise, this model leaves {share(c.unexplained)} unexplained.")
    _regions(console, c.where, verbose)
    _effects(console, c)
    _notes(console, "Warnings:", c.warnings)
    return _text(out)


def explanation_text(e: Explanation, *, verbose: bool = False, colour: bool = False, width: int = WIDTH) -> str:
    """Return the ladder, the answer, what each effect means in the plant, and what stays unexplained."""
    console, out = _console(colour, width)
    _head(console, e, "which effect is missing?")
    console.print(Text(ladder(e.steps, e.noise_floor), style="bold"))
    _say(console, "\n" + terminal(verdict(e)))
    for note in e.reasons:
        _say(console, terminal(note.message), indent=2)
    _effects(console, e)
    for sentence in look_alike_words(e):
        _say(console, sentence)
    if e.adequate:
        _say(console, rest_words(e))
    _candidates(console, e, verbose)
    if e.unexplained is not None:
        _say(console, f"\nOf the squared error above the noise, {share(e.unexplained)} stays unexplained.")
    _regions(console, e.where, verbose, limit=3)
    _notes(console, "Warnings:", e.warnings)
    return _text(out)


def _console(colour: bool, width: int) -> tuple[Console, io.StringIO]:
    out = io.StringIO()
    console = Console(
        file=out, width=min(width, WIDTH), force_terminal=colour, color_system="standard" if colour else None,
        highlight=False, markup=False, emoji=False, legacy_windows=False,
    )
    return console, out


def _text(out: io.StringIO) -> str:
    return "\n".join(line.rstrip() for line in out.getvalue().splitlines()) + "\n"


def _head(console: Console, found: Comparison | Explanation, words: str) -> None:
    about = span_words(found)
    console.print(Text(f"{terminal(found.loop, 60)}: {words}", style="bold"))
    if about:
        console.print(about)
    console.print("Errors in % of the PV span; hold-out is the error on samples the fit did not see.\n")


def _say(console: Console, text: str, indent: int = 0) -> None:
    console.print(Padding(Text(text.lstrip("\n")), (text.startswith("\n"), 0, 0, indent)))


def _table(*columns: str) -> Table:
    table = Table(box=None, pad_edge=False, header_style="bold", padding=(0, 2, 0, 0))
    for place, column in enumerate(columns):
        last = place == len(columns) - 1
        table.add_column(column, justify="left" if last or not column else "right", no_wrap=not last,
                         ratio=1 if last else None, overflow="fold")
    return table


def _regions(console: Console, regions: Sequence[Region], verbose: bool, limit: int = REGIONS) -> None:
    if not regions:
        return
    _say(console, "\nWhere the model fails, worst first (regions overlap):")
    table = _table("error", "where")
    shown = regions if verbose else (fails(regions) or list(regions))[:limit]
    for r in shown:
        table.add_row(error_size(r.rmse), Text(terminal(r.sentence or r.region, 300)))
    console.print(table)
    if len(regions) > len(shown):
        console.print("(--verbose lists every region)")


def _effects(console: Console, found: Comparison | Explanation) -> None:
    if not found.effects:
        return
    start = None if found.series is None else float(found.series.time[0])
    _say(console, "\nWhat it means in the plant:")
    for effect in found.effects:
        said = ", ".join(f"{name} = {text}" for name, text in numbers(effect, found.settings, start).items())
        _say(console, f"{plain_name(effect.effect)}: {said}", indent=2)
        _say(console, terminal(meaning(effect, found.settings, start)), indent=4)
        if sureness(effect):
            _say(console, sureness(effect), indent=4)
        for note in effect.notes:
            _say(console, terminal(f"Take care: {note.message}."), indent=4)


def _candidates(console: Console, e: Explanation, verbose: bool) -> None:
    if not e.candidates:
        return
    _say(console, "\nEach effect tried alone, best first:")
    table = _table("hold-out", "error gone", "evidence", "effect")
    shown = e.candidates if verbose else e.candidates[:CANDIDATES]
    start = None if e.series is None else float(e.series.time[0])
    for c in shown:
        became = candidate_verdict(e, c)
        words = plain_name(c.effect) + (f" ({became})" if became else "")
        if verbose:
            words += ": " + ", ".join(f"{name} = {text}" for name, text in numbers(c, e.settings, start).items())
        evidence = "" if c.evidence is None else f"{c.evidence:.0f}"
        table.add_row(error_size(c.rmse_holdout), share(c.error_reduction), evidence, Text(terminal(words, 300)))
    console.print(table)
    _say(console, "(error gone: share of the squared error; evidence: how much likelier the record is, 20 are needed)")
    if len(e.candidates) > len(shown):
        console.print(f"and {len(e.candidates) - len(shown)} more; --verbose lists all of them with their numbers")


def _notes(console: Console, title: str, notes: Sequence[Note]) -> None:
    if not notes:
        return
    _say(console, "\n" + title)
    for note in notes:
        _say(console, f"{note.code}: {terminal(note.message, 400)}", indent=2)
