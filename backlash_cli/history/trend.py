"""From nights to wear: what the dead band is now, how it grows since the last repair, and when it reaches the limit.

How each kind of night is used:
- a size (backlash, suspected): a point with the error of its own interval, twice as much where it is only suspected;
- no_backlash with a limit of detection: a bound. One or a few among sizes are nights that missed it; a run of them, too
  long for that, is a repair;
- anything else (cannot_tell, oscillating, insufficient_data, error, no limit of detection): a gap, named, not a zero.
The time of a night is the middle of its data; the clock is never asked."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pandas as pd
from scipy.stats import binom

from ..results import Verdict
from ..results.history import DAY, HeldOut, Limit, Night, Repair, Segment, Wear, day_of, missing_days
from .local_trend import BELIEF, ENOUGH, LEAST, LINE, Nights, Trend, find_shocks, fit

SAME_REPAIR = 5  # a drop found this close (in nights) to a marked repair is that repair
SMALLEST_SHARE, SMALLEST = 0.25, 0.005  # of the dead band and of the output span, that a repair takes away at least
WINDOW = 7  # nights on either side that say how large the dead band was
QUIET = 14  # nights in which nearly all must be silent for a repair
SILENT = 0.8  # nearly all
CHANCE = 0.01  # that nights of an unchanged valve look like that in one history
QUIETEST = 0.01  # relative error of a night is never taken as smaller than this
HIDDEN = 0.25  # share of the last nights, on which a straight line and the local trend are compared
UNLIKELY = 1.0  # times its belief that the nights have to leave a line, not to have failed
CLEAR = 1.0  # log likelihood of the hidden nights by which a line has to be worse, to have failed
DRAWN = 120.0  # days beyond the last night that a figure shows at most


def wear(loop: str, nights: Sequence[Night], marked: Sequence[Repair], limit: Limit) -> Wear:
    """Return the wear of one loop from its nights, in any order, and the repairs that people marked."""
    nights = sorted(nights, key=lambda n: n.time)
    points, gaps = points_of(nights)
    covered = (day_of(k * DAY) for n in nights for k in range(int(n.start // DAY), int(n.end // DAY) + 1))
    repairs, parts = tuple(marked), _between(points, marked)
    if found := _found(loop, parts):
        repairs = tuple(sorted([*marked, *found], key=lambda r: r.time))
        parts = _between(points, repairs)
    out = Wear(loop, nights, limit, "no_estimate", tuple(segment for _, segment, _ in parts if segment),
               repairs, gaps=tuple(gaps), missing_days=tuple(missing_days(covered)))
    # after the last repair nothing may have been measured yet: then no older slope speaks for the valve
    _, segment, trend = parts[-1]
    if segment is None:
        return out
    if trend is None or segment.slope_ci95 is None:
        return replace(out, state="too_few_nights" if segment.nights or segment.below < ENOUGH else "no_trend")
    compared, stepped = held_out(trend.nights), bool(trend.nights.steps.any())
    holds = not stepped and (compared is None or compared.straight_line_holds)
    # a line has to stand both tests: the nights that it has not seen, and all of them against trends that bend
    line = holds and trend.straight >= UNLIKELY * BELIEF[LINE]
    last = len(trend.nights) - 1
    grows = segment.slope_ci95[0] > 0 or (stepped and trend.low[last] > trend.high[0])
    used = fit(trend.nights, (LINE,)) if line and grows else trend
    value, early, late = used.reaches(limit.value)
    out = replace(out, model="line" if line else "local", held_out=compared, state="growing" if grows else "no_trend")
    passed = used.days[0] < value and late <= used.days[last]  # in these nights, for sure
    if not passed and (not grows or not np.isfinite(value)):
        return replace(out, earliest=DAY * early if np.isfinite(early) and segment.level < limit.value else None)
    # as far as a figure shows it
    ahead = used.days[last] + np.linspace(0.0, min(value + 3.0 - used.days[last], DRAWN), 12)
    return replace(out, limit_date=(DAY * value, DAY * early, DAY * late),
                   forecast=used.path(ahead) if value > used.days[last] else ())


Part = tuple[list[Night], Segment | None, Trend | None]  # nights between two repairs and their wear


def _between(points: Sequence[Night], repairs: Sequence[Repair]) -> list[Part]:
    edges = [-np.inf, *sorted(r.time for r in repairs), np.inf]
    parts = ([p for p in points if first <= p.time < last] for first, last in pairwise(edges))
    return [(part, *_fitted(part)) for part in parts]


def _fitted(part: Sequence[Night]) -> tuple[Segment | None, Trend | None]:
    """Return the wear of nights, and the trend where at least five of them have a size."""
    if not part:
        return None, None
    sized = [p for p in part if p.d is not None]
    out = Segment(part[0].time, part[-1].time, len(sized), len(part) - len(sized))
    if not sized:  # nothing but bounds: somewhere below
        bound = float(np.median([p.limit_of_detection or 0.0 for p in part]))
        return replace(out, level_first=0.5 * bound, level=0.5 * bound, level_ci95=(0.0, bound)), None
    measured = measurements(sized)
    if len(sized) < ENOUGH:
        level = float(np.median(measured.size))
        spread = 1.96 * float(np.median(measured.error)) + float(np.abs(measured.size - level).max())
        return replace(out, level_first=level, level=level, level_ci95=(max(level - spread, 0.0), level + spread)), None
    trend = fit(find_shocks(measured))
    now, low, high = trend.at(part[-1].time / DAY).tolist()
    slope, *ends = trend.slope
    return replace(out, slope=slope, slope_ci95=(ends[0], ends[1]), level_first=float(trend.level[0]), level=now,
                   level_ci95=(max(low, 0.0), high), path=trend.path(trend.nights.days)), trend


def points_of(nights: Sequence[Night]) -> tuple[list[Night], list[tuple[str, str]]]:
    """Return the nights that say something, with the size that counts, and the others as (day, code of the reason).

    Two kinds of estimate are never mixed: the one that most nights have stands for the loop."""
    sized = [n for n in nights if n.d is not None]
    source = "confirmation" if 2 * sum(n.source == "confirmation" for n in sized) >= len(sized) else "cluster"
    points, gaps = [], []
    for night in nights:
        other = night.details.get(source)
        if night.below_detection or (night.d is not None and night.source == source):
            points.append(night)
        elif night.d is not None and isinstance(other, dict) and other.get("d") is not None:
            points.append(replace(night, d=float(other["d"]), ci95=None))
        else:
            code = "no_size" if night.d is not None else night.reasons[0].code if night.reasons else str(night.verdict)
            gaps.append((day_of(night.time), code))
    return points, gaps


def measurements(sized: Sequence[Night]) -> Nights:
    """Return sizes with their errors, from nights in time order that all have a size; days since 1970.

    The usual interval at that time counts, or the night's own where that is much wider; not the night's own dead band,
    which would pull low. What neighbouring nights scatter more, or less, than their intervals say corrects them all."""
    time, size = np.array([[p.time / DAY, p.d] for p in sized], float).T
    half = np.array([0.5 * (p.ci95[1] - p.ci95[0]) if p.ci95 else np.nan for p in sized])
    about = pd.DataFrame({"usual": half, "level": size}).rolling(WINDOW, center=True, min_periods=1).median()
    usual, level = about.to_numpy().T
    scatter = float(np.median(np.abs(np.diff(size)))) / 0.6745 / 2**0.5 if len(size) > 1 else 0.0
    error = np.where(half > 2.0 * usual, half, usual) / 1.96
    error = np.where(np.isfinite(error), error, np.nanmedian(error) if np.isfinite(error).any() else scatter)
    error = np.maximum(error, QUIETEST * np.maximum(level, 1e-4))
    if len(size) > ENOUGH:
        # each night against the line between its neighbours, so that wear itself does not count
        share = (time[2:] - time[1:-1]) / np.maximum(time[2:] - time[:-2], 1e-9)
        off = size[1:-1] - share * size[:-2] - (1 - share) * size[2:]
        z = np.abs(off) / np.sqrt(error[1:-1] ** 2 + (share * error[:-2]) ** 2 + ((1 - share) * error[2:]) ** 2)
        trust = 2.0 * LEAST  # nights that the intervals' own word is worth
        error *= np.sqrt((trust + len(z) * (np.median(z) / 0.6745) ** 2) / (trust + len(z)))
    error *= np.where([p.verdict is Verdict.SUSPECTED for p in sized], 2.0, 1.0)
    return Nights(time, size, error, *np.zeros((2, len(size)), bool))


def _found(loop: str, parts: Sequence[Part]) -> list[Repair]:
    """Return repairs seen in the data that nobody marked; searched between the marked ones.

    Wear makes a dead band grow slowly; nothing but a repair makes it fall, suddenly and lastingly. Either a step of the
    sizes down (`find_shocks`), or nights that nearly all see no dead band where nearly all did before."""
    out = []
    for number, (nights, _, trend) in enumerate(parts):
        sized = [k for k, p in enumerate(nights) if p.d is not None]
        steps = [] if trend is None else [(k, *trend.level[k - 1 : k + 1].tolist(), trend.nights.size) for k in
                                          np.flatnonzero(trend.nights.steps)]
        # the sizes have to fall as well: a trend may fall back where it rose too early
        falls = [(sized[k], before, after) for k, before, after, size in steps if _fell(before, after) and
                 np.median(size[max(k - WINDOW, 0) : k]) - np.median(size[k : k + LEAST]) > 0.3 * (before - after)]
        falls += [fall for fall in _falls_silent(nights) if all(abs(fall[0] - k) > WINDOW for k, _, _ in falls)]
        for k, before, after in sorted(falls):
            if (number and k <= SAME_REPAIR) or (number + 1 < len(parts) and len(nights) - k <= SAME_REPAIR):
                continue
            last, first = nights[k - 1].time, nights[k].time
            midnight = first // DAY * DAY
            note = f"found: dead band fell from {100 * before:.2g} % to {100 * after:.2g} %"
            out.append(Repair(loop, midnight if midnight > last else 0.5 * (last + first), note, True, before, after))
    return out


def _fell(before: float, after: float) -> bool:
    return before - after >= SMALLEST and after <= (1 - SMALLEST_SHARE) * before


def _falls_silent(part: Sequence[Night]) -> list[tuple[int, float, float]]:
    """Return where nearly all nights fall silent, so many that they cannot have missed the dead band by chance."""
    silent = np.array([p.d is None for p in part], bool)
    value = np.array([p.limit_of_detection if p.d is None else p.d for p in part], float)
    found: list[tuple[int, float, float]] = []
    for k in (np.flatnonzero(silent[1:] & ~silent[:-1]) + 1).tolist():
        first = max(found[-1][0] if found else 0, k - 2 * QUIET)
        before, after = silent[first:k], silent[k : k + QUIET]
        m, s, sizes = len(after), int(after.sum()), value[first:k][~before]
        if m < LEAST or s < SILENT * m or len(sizes) < LEAST:
            continue
        high, low = float(np.median(sizes[-WINDOW:])), float(np.median(value[k : k + QUIET][after]))
        missed = (before.sum() + 1.0) / (len(before) + 2.0)
        if _fell(high, low) and binom.sf(s - 1, m, missed) * len(part) < CHANCE:
            found.append((k, high, low))
    return found


def held_out(nights: Nights) -> HeldOut | None:
    """Compare a straight line and the local trend on the last nights, that neither fit has seen; None with too few.

    Which nights lie apart, and where steps are, is known to both from all nights."""
    count = len(nights) - min(max(int(HIDDEN * len(nights)), LEAST), 30)
    hidden = count + np.flatnonzero(~nights.apart[count:])
    if count < 2 * ENOUGH or not len(hidden):
        return None
    days, size, error = nights.days[hidden], nights.size[hidden], nights.error[hidden]
    scores, off = [], []
    for ways in ((LINE,), tuple(BELIEF)):
        mean, low, high = fit(nights.part(0, count), ways).at(days)
        variance = ((high - low) / 3.92) ** 2 + error**2
        scores.append(float(-0.5 * ((size - mean) ** 2 / variance + np.log(variance)).sum()))
        off.append(size - mean)
    line, local = (float(np.median(np.abs(x))) for x in off)
    return HeldOut(len(hidden), day_of(days[0] * DAY), line, local, float(np.median(off[0])),
                   scores[0] >= scores[1] - CLEAR)
