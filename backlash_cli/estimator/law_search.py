"""Which time scale, filter, sampling instant and terms explain the output best: the search behind identify."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import isfinite

import numpy as np

from ..record import Note
from .control_law import (
    DERIVATIVE,
    INTEGRAL,
    PROPORTIONAL,
    SETPOINT,
    LawFit,
    LawForm,
    LawRows,
    search_filter,
    settle_filter,
)
from .identification import NOISE_UNSEEN, Identification, summarise
from .survey import ROWS

WINDOW = 10.0  # Ti per window: long enough for K/Ti, short enough for drift that is not the controller's
FIRST_WINDOW = 200  # rows, before Ti is known
MIN_WINDOW = 20  # rows
LONGEST_FILTER = 0.3  # Tf / Ti: the tool's own default is 0.1, Td/5 is below
UNSETTLED = 3.0  # longest Tf, in samples, below which the newest sample matters
SLOWEST = 64.0  # rows per Ti above which the next slower picture serves as well
UNCLEAR_FILTER = 0.2  # Tf / Ti
LEAST_EXPLAINED = 0.5  # below, the output is not made by this control law
SURELY_EXPLAINED = 0.9  # below, a gain that may be zero is a fit by chance (two drifting signals)
ONE_FREQUENCY = 0.92  # single sines are above, 98 % of other simulated loops below 0.93
FILTER_SHARE = 0.1  # Tf / Ti assumed there: the tool's own default
EXACT = 1e-5  # share unexplained below which nothing is left to add
CLEARLY = 4.0  # standard errors by which a richer form must be better
PLAUSIBLE = 2.0  # standard errors by which a fit may be worse than the best and still count


AT_ONE_FREQUENCY = Note(
    "one_frequency",
    "the loop moves at one frequency only: K and Ti can only be told apart by assuming the measurement filter (Ti/10)",
)


def find_settings(picture: Callable[[int], LawRows | None], interval: float) -> Identification | Note:
    """Find K, Ti and Td from pictures of one record; `interval` is that of the samples [s].

    picture: gives that of a level, 0 the finest, None where there is none; there is one of level 0.
    """
    found = _time_scale(picture)
    if isinstance(found, Note):
        return found
    rows, form, longest = found
    averaged = rows.interval > interval
    ways = [form]
    if not averaged:
        phases = (0.25, 0.0, 0.5) if longest < UNSETTLED * interval else (0.0,)
        ways = [*(replace(form, phase=phase) for phase in phases), replace(form, phase=0.0, shift=1)]
    fits = _most_plausible([search_filter(rows, way, longest) for way in ways])
    if not fits:
        return _refused(0.0)
    resolved = averaged or rows.interval < NOISE_UNSEEN * fits[0].reset_time
    if resolved and fits[0].unexplained > EXACT:
        pid = search_filter(rows, replace(fits[0].form, terms=(*form.terms, DERIVATIVE)), longest)
        if pid and derivative_is_real(pid[0], fits[0]):
            fits = pid
    if fits[0].one_frequency > ONE_FREQUENCY:
        fits = settle_filter(rows, replace(form, shift=0), FILTER_SHARE)
        return summarise(rows, fits, averaged, (AT_ONE_FREQUENCY,)) if fits else AT_ONE_FREQUENCY
    refined = search_filter(rows, fits[0].form, longest, near=fits[0].filter_time)
    fits = sorted(refined, key=lambda fit: fit.unexplained) + fits
    best = fits[0]
    if not isfinite(best.reset_time) or best.unexplained > 1.0 - LEAST_EXPLAINED:
        return _refused(1.0 - best.unexplained)
    # A filter as slow as the controller itself cannot be told from integral action: no fit is excluded then.
    unclear = best.filter_time > UNCLEAR_FILTER * best.reset_time
    plausible = fits if unclear else [fit for fit in fits if best.better_than(fit) <= PLAUSIBLE]
    result = summarise(rows, plausible, averaged)
    by_chance = result.K.ci95[0] < 0.0 < result.K.ci95[1] and result.r2 < SURELY_EXPLAINED
    return _refused(result.r2, by_chance=True) if by_chance else result


def _time_scale(picture: Callable[[int], LawRows | None]) -> tuple[LawRows, LawForm, float] | Note:
    """Find the picture of the record in which Ti is SLOWEST rows at most, the form of the fit, and the longest Tf."""
    rows = picture(0)
    assert rows is not None
    level, Ti, explained = 0, FIRST_WINDOW / WINDOW * rows.interval, 0.0
    for _ in range(8):
        h = rows.interval
        window = window_of(WINDOW * Ti / h, len(rows.index))
        longest = min(LONGEST_FILTER * Ti, 0.1 * window * h)
        moves = bool(np.ptp(rows.signals[0]) > 0)
        terms = (PROPORTIONAL, INTEGRAL, SETPOINT) if moves else (PROPORTIONAL, INTEGRAL)
        phase = 0.5 if level else 0.0 if Ti >= 10.0 * h else 0.25
        form = LawForm(terms, window, min(int(np.ceil(5.0 * longest / h)) + 1, window), 0, phase)
        fits = search_filter(rows, form, longest, step=4.0)
        if not fits and moves:  # the setpoint moved between the windows only
            form = replace(form, terms=(PROPORTIONAL, INTEGRAL))
            fits = search_filter(rows, form, longest, step=4.0)
        if not fits:
            return _refused(0.0)
        before, explained = Ti, 1.0 - fits[0].unexplained
        Ti = fits[0].reset_time
        slower = None if Ti <= SLOWEST * h else picture(level + 1)
        if slower is not None:
            rows, level = slower, level + 1
            Ti = Ti if isfinite(Ti) else FIRST_WINDOW / WINDOW * rows.interval
        elif not isfinite(Ti):
            return _refused(explained)
        elif 0.8 < Ti / before < 1.25:
            break
    return rows, form, longest


def window_of(wanted: float, rows: int) -> int:
    """Return the rows of a window, `wanted` where a record of so many rows holds six of them."""
    return int(np.clip(wanted, MIN_WINDOW, max(min(ROWS, rows // 6), MIN_WINDOW)))


def _most_plausible(searches: list[list[LawFit]]) -> list[LawFit]:
    """Fits of the first assumption in the list, unless another is better beyond chance; with all that fit as well.

    Which sample the integral has taken in and whether the output is logged a sample late matter at coarse rates only.
    """
    searches = [fits for fits in searches if fits and isfinite(fits[0].reset_time)]
    if not searches:
        return []
    lead = min(searches, key=lambda fits: fits[0].unexplained)
    chosen = next(fits for fits in searches if lead[0].better_than(fits[0]) <= PLAUSIBLE or fits is lead)
    others = [fits for fits in searches if fits is not chosen and fits[0].better_than(chosen[0]) > -PLAUSIBLE]
    return chosen + [fit for fits in others for fit in fits]


def derivative_is_real(pid: LawFit, pi: LawFit) -> bool:
    """A first-order filter looks like a D part with Td = Tf; a real one is longer, and clearly better."""
    Td = pid.values[pid.form.terms.index(DERIVATIVE)] / pid.gain
    return Td > max(2.0 * pid.filter_time, 0.02 * pid.reset_time) and pid.better_than(pi) > CLEARLY


def _refused(explained: float, *, by_chance: bool = False) -> Note:
    if explained > LEAST_EXPLAINED and not by_chance:
        return Note(
            "proportional_part_unseen",
            "the output follows the sum of the control error, but no P part shows: the data are compressed, "
            "interpolated or too coarse, so K and Ti cannot be read from them",
            {"r2": explained},
        )
    return Note(
        "not_this_controller",
        f"a PI or PID controller of these signals explains {100 * max(explained, 0.0):.0f} % of the output's motion: "
        "other signals, manual operation, limits or feedforward move it, or the columns do not belong together",
        {"r2": explained},
    )
