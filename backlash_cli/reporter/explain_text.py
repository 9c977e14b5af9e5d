"""Comparison and explanation on a terminal: the answer first, then the numbers behind it, in plain words."""

from __future__ import annotations

from collections.abc import Sequence

from ..results import Comparison, Explanation, Region
from .console import WIDTH, Screen
from .explain_words import (
    candidate_verdict,
    effect_words,
    error_size,
    fails,
    ladder,
    look_alike_words,
    plain_name,
    rest_words,
    share,
    span_words,
    still_holds,
    unexplained_words,
    verdict,
)
from .parameter_words import said_numbers
from .safe import terminal

REGIONS = 8  # rows of the table of regions, unless all are asked for
CANDIDATES = 6


def comparison_text(c: Comparison, *, verbose: bool = False, colour: bool = False, width: int = WIDTH) -> str:
    """Return how well the model fits, what is the best to hope for, and where it fails, worst first."""
    screen = _begun(c, "model against measurement", colour, width)
    names = ", ".join(plain_name(e.effect) for e in c.effects)
    this = ["this model", error_size(c.fitness.rmse), error_size(c.fitness.rmse_holdout),
            f"with {names}" if names else "gain, lag and offset of the model file"]
    screen.table(("", ">fit", ">hold-out", ""), [
        *([] if c.fitted else [this]),
        ["plain model", error_size(c.baseline.rmse), error_size(c.baseline.rmse_holdout),
         "gain, one lag and offset" + ("; this is the model compared" if c.fitted else "")],
        ["noise floor", error_size(c.noise_floor), "", "no model can do better than the measurement noise"],
    ])
    if still_holds(c):
        screen.say("\n" + still_holds(c))
        for note in c.reasons:
            screen.say("- " + terminal(note.message, 400), indent=2)
    if unexplained_words(c):
        screen.say("\n" + unexplained_words(c))
    _regions(screen, c.where, verbose)
    _effects(screen, c)
    screen.notes("Warnings:", c.warnings)
    return screen.text()


def explanation_text(e: Explanation, *, verbose: bool = False, colour: bool = False, width: int = WIDTH) -> str:
    """Return the ladder, the answer, what each effect means in the plant, and what stays unexplained."""
    screen = _begun(e, "which effect is missing?", colour, width)
    screen.say(ladder(e.steps, e.noise_floor), style="bold")
    screen.say("\n" + terminal(verdict(e)))
    for note in e.reasons:
        screen.say(terminal(note.message), indent=2)
    _effects(screen, e)
    for sentence in [*look_alike_words(e), *([rest_words(e)] if e.adequate else [])]:
        screen.say(sentence)
    _candidates(screen, e, verbose)
    if unexplained_words(e):
        screen.say("\n" + unexplained_words(e))
    _regions(screen, e.where, verbose, limit=3)
    screen.notes("Warnings:", e.warnings)
    return screen.text()


def _begun(found: Comparison | Explanation, words: str, colour: bool, width: int) -> Screen:
    screen = Screen(colour=colour, width=min(width, WIDTH))
    screen.say(f"{terminal(found.loop, 60)}: {words}", style="bold")
    if about := span_words(found):
        screen.say(about)
    screen.say("Errors in % of the PV span; hold-out is the error on samples the fit did not see.")
    screen.say()
    return screen


def _regions(screen: Screen, regions: Sequence[Region], verbose: bool, limit: int = REGIONS) -> None:
    if not regions:
        return
    screen.say("\nWhere the model fails, worst first (regions overlap):")
    shown = regions if verbose else (fails(regions) or list(regions))[:limit]
    screen.table((">error", "where"), [[error_size(r.rmse), terminal(r.sentence or r.region, 300)] for r in shown])
    if len(regions) > len(shown):
        screen.say("(--verbose lists every region)")


def _effects(screen: Screen, found: Comparison | Explanation) -> None:
    if found.effects:
        screen.say("\nWhat it means in the plant:")
    start = None if found.series is None else float(found.series.time[0])
    for effect in found.effects:
        screen.say(f"{plain_name(effect.effect)}: {said_numbers(effect, found.settings, start)}", indent=2)
        for sentence in effect_words(effect, found.settings, start):
            screen.say(terminal(sentence), indent=4)


def _candidates(screen: Screen, e: Explanation, verbose: bool) -> None:
    if not e.candidates:
        return
    screen.say("\nEach effect tried alone, best first:")
    shown = e.candidates if verbose else e.candidates[:CANDIDATES]
    start = None if e.series is None else float(e.series.time[0])
    rows = []
    for c in shown:
        became = candidate_verdict(e, c)
        words = plain_name(c.effect) + (f" ({became})" if became else "")
        words += f": {said_numbers(c, e.settings, start)}" if verbose else ""
        rows.append([error_size(c.rmse_holdout), share(c.error_reduction),
                     "" if c.evidence is None else f"{c.evidence:.0f}", terminal(words, 300)])
    screen.table((">hold-out", ">error gone", ">evidence", "effect"), rows)
    screen.say("(error gone: share of the squared error; evidence: how much likelier the record is, 20 are needed)")
    if len(e.candidates) > len(shown):
        screen.say(f"and {len(e.candidates) - len(shown)} more; --verbose lists all of them with their numbers")
