"""How well wear that bends is followed: python -m tests.benchmarks.wear [histories of each kind].

The truth is a curve without any model behind it (straight, ever faster or slower, in steps, or S-shaped); a night is
the curve times noise, with the interval that a scan would give it. Three nights in ten are missed: half of them have no
export, the other half see no dead band although there is one; some nights are outliers. Printed for each kind: error of
the present level and how often its interval holds the truth, error of the slope of the last month, how often the
interval of the date of the limit holds the true day, and how often a repair is found where none was made. Last:
histories with one repair, and sixty nights to 4 % that bend in thirteen ways, each size within 3 % of the truth.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from backlash_cli.history.trend import wear
from backlash_cli.results import Verdict
from backlash_cli.results.history import DAY, Limit, Night, Wear

START = 1772323200.0 + 0.5 * DAY  # middle of the first night
KINDS = ("linear", "accelerating", "saturating", "stepped", "s_shaped")
MISSED = 0.3
OUTLIERS = 0.04
MONTH = 30

Curve = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class History:
    """One history: the true curve over days, its nights, the limit and the day on which the curve reaches it (inf)."""

    curve: Curve
    days: int
    nights: list[Night]
    limit: float
    day: float


def curve_of(kind: str, days: int, rng: np.random.Generator) -> Curve:
    """Return dead band [span] over days, from about 1 % at day 0 to 2-5 % at `days`, going on in the same way."""
    first, last = rng.uniform(0.008, 0.015), rng.uniform(0.02, 0.05)
    if kind == "linear":
        return lambda t: first + (last - first) * t / days
    if kind == "accelerating":
        if rng.random() < 0.5:
            return lambda t: first * (last / first) ** (t / days)
        power = rng.uniform(1.7, 3.0)
        return lambda t: first + (last - first) * (t / days) ** power
    if kind == "saturating":
        rate = rng.uniform(1.5, 4.0)
        return lambda t: first + (last - first) * (1 - np.exp(-rate * t / days)) / (1 - np.exp(-rate))
    if kind == "s_shaped":
        middle, width = rng.uniform(0.4, 0.9) * days, rng.uniform(0.06, 0.14) * days
        return lambda t: first + (last - first) / (1 + np.exp((middle - t) / width))
    gap = days / rng.uniform(2.5, 5.0)  # one step per so many days, at a random moment in each
    at = gap * (np.arange(40) + rng.uniform(0.1, 0.9, 40))
    sizes = (last - first) * gap / days * rng.uniform(0.6, 1.4, 40)
    return lambda t: first + (sizes * (np.asarray(t)[..., None] >= at)).sum(-1)


def made(kind: str, seed: int, repair: bool = False) -> History:
    """Return one history with noise, missed nights and outliers; `repair`: the curve begins anew about half way."""
    rng = np.random.default_rng([KINDS.index(kind), seed, repair])
    days = int(rng.integers(45, 121))
    curve = grown = curve_of(kind, days, rng)
    if repair:
        at = int(rng.integers(days // 3, 2 * days // 3))

        def curve(t: np.ndarray) -> np.ndarray:
            return np.where(np.asarray(t) < at, grown(np.asarray(t)), grown(np.maximum(np.asarray(t) - at, 0.0)))

    t = np.arange(days, dtype=float)
    truth = curve(t)
    spread = rng.uniform(0.03, 0.08)
    size = truth * (1 + spread * rng.normal(size=days))
    wild = rng.random(days) < OUTLIERS
    size = np.where(wild, truth * np.exp(rng.choice((-1, 1), days) * rng.uniform(0.3, 0.9, days)), size)
    half = 1.96 * spread * size * np.exp(0.2 * rng.normal(size=days))
    missed = rng.random(days)
    nights = [_night(k, size[k], half[k], missed[k] < MISSED) for k in range(days) if not missed[k] < MISSED / 2]
    ahead = np.arange(0, 20 * days, 0.05)
    crossing = rng.uniform(0.7, 1.3) * days  # where the limit is placed
    limit = float(curve(np.array([crossing]))[0]) if kind != "stepped" else float(
        np.mean(curve(np.array([crossing - 0.2 * days, crossing + 0.2 * days]))))
    if repair:
        limit = 0.1
    reached = np.flatnonzero(curve(ahead) >= limit)
    return History(curve, days, nights, limit, float(ahead[reached[0]]) if len(reached) else np.inf)


def _night(day: int, d: float, half: float, silent: bool) -> Night:
    start = START + DAY * (day - 0.5)
    if silent:
        return Night("X", start, start + DAY - 1, Verdict.NO_BACKLASH, 0.8, limit_of_detection=0.6 * d)
    return Night("X", start, start + DAY - 1, Verdict.BACKLASH, 0.95, d, (d - half, d + half), "confirmation")


@dataclass
class Score:
    """What one history gave: relative errors and hits, NaN where it does not apply."""

    level: float
    level_hit: bool
    slope: float
    slope_hit: float
    date_hit: float
    width: float
    repairs: int
    model: str


def scored(history: History, found: Wear) -> Score:
    """Compare a wear with the truth."""
    now = found.now
    assert now is not None and now.level is not None and now.level_ci95 is not None
    last = (found.segments[-1].last - START) / DAY
    truth, month = (float(history.curve(np.array([t]))[0]) for t in (last, max(last - MONTH, 0.0)))
    growth = (truth - month) / min(MONTH, last)
    # a slope of next to nothing has no relative error
    slope, slope_hit = np.nan, np.nan
    if now.slope is not None and now.slope_ci95 is not None:
        slope = now.slope / growth - 1 if growth > 0.1 * truth / last else np.nan
        slope_hit = float(now.slope_ci95[0] <= growth <= now.slope_ci95[1])
    hit, width = np.nan, np.nan
    if found.limit_date is not None:
        _, early, late = ((x - START) / DAY for x in found.limit_date)
        hit, width = float(early - 0.5 <= history.day <= late + 0.5), late - early
    elif truth < history.limit:  # no date: until the earliest day it is said not to be reached
        hit = float(history.day >= ((found.earliest or np.inf) - START) / DAY - 0.5)
    return Score(now.level / truth - 1, now.level_ci95[0] <= truth <= now.level_ci95[1], slope, slope_hit, hit, width,
                 sum(r.found for r in found.repairs), getattr(found, "model", ""))


def judged(kind: str, histories: int) -> list[Score]:
    """Return the scores of one kind."""
    out = []
    for seed in range(histories):
        history = made(kind, seed)
        out.append(scored(history, wear("X", history.nights, (), Limit(history.limit, "a", "benchmark"))))
    return out


def repairs(histories: int) -> tuple[float, float]:
    """Return the share of repairs that are found, and the share of those found that are none.

    A repair takes away at least a quarter and half a per cent of span, else it cannot be told from wear and noise. One
    that is found is true with at most three nights between it and the true one.
    """
    real = false = made_ = 0
    for seed in range(histories):
        history = made(KINDS[seed % 4], seed, repair=True)
        truth = history.curve(np.arange(history.days, dtype=float))
        at = int(np.argmin(np.diff(truth))) + 1
        time = START + DAY * (at - 0.5)
        found = [r.time for r in wear("X", history.nights, (), Limit(0.1, "a", "benchmark")).repairs if r.found]
        sized = [n.time for n in history.nights if n.d is not None]
        near = any(sum(min(t, time) <= night < max(t, time) for night in sized) <= 3 for t in found)
        fair = truth[at - 1] - truth[at] >= 0.005 and truth[at] <= 0.75 * truth[at - 1]
        made_ += fair
        real += fair and near
        false += len(found) - near
    return real / made_, false / max(real + false, 1)


BENDING: dict[str, Curve] = {  # per cent over days 0 to 59
    "exponential": lambda t: 0.9 * (4.0 / 0.9) ** (t / 59),
    "square": lambda t: 1 + 3 * (t / 59) ** 2,
    "cubic": lambda t: 1 + 3 * (t / 59) ** 3,
    "saturating": lambda t: 1 + 3 * np.expm1(-2 * t / 59) / np.expm1(-2),
    "nearly saturated": lambda t: 1 + 3 * np.expm1(-3.5 * t / 59) / np.expm1(-3.5),
    "square root": lambda t: 1 + 3 * np.sqrt(t / 59),
    "logarithmic": lambda t: 1 + 3 * np.log1p(t / 5) / np.log1p(59 / 5),
    "s-shaped": lambda t: 1 + 3 / (1 + np.exp((30 - t) / 6)),
    "kinked": lambda t: 1 + 3 * np.maximum(t - 35, 0) / 24,
    "begun half way": lambda t: 1 + 3 * np.maximum(t - 30, 0) / 29,
    "begun late": lambda t: 1 + 3 * np.maximum(t - 50, 0) / 9,
    "in waves": lambda t: 1 + 3 * (t / 59 + 0.08 * np.sin(2 * np.pi * t / 30)),
    "in steps": lambda t: 1 + 0.6 * (t[..., None] >= np.array([9, 21, 33, 44, 54])).sum(-1),
}


def sixty_nights(kind: str, seed: int) -> tuple[History, Wear]:
    """Return sixty nights to 4 %, growing as BENDING says, sizes within 3 % of the truth; the limit is 3 %."""
    rng = np.random.default_rng([60, seed])

    def curve(t: np.ndarray) -> np.ndarray:
        return 0.01 * BENDING[kind](np.asarray(t, float))

    d = curve(np.arange(60.0)) * (1 + rng.uniform(-0.03, 0.03, 60))
    fine = np.arange(0.0, 60.0, 0.01)
    day = float(fine[np.argmax(curve(fine) >= 0.03)])
    history = History(curve, 60, [_night(k, d[k], 0.05 * d[k], False) for k in range(60)], 0.03, day)
    return history, wear("X", history.nights, (), Limit(0.03, "no_positioner", "benchmark"))


def line_of(name: str, scores: list[Score]) -> str:
    """Return one line of the table."""
    dates = np.array([s.date_hit for s in scores])
    widths = np.array([s.width for s in scores])
    slopes = np.abs([s.slope for s in scores])
    models = {m: sum(s.model == m for s in scores) for m in sorted({s.model for s in scores})}
    hits = np.array([s.slope_hit for s in scores])
    levels = np.abs([s.level for s in scores])
    held, found = (np.mean(x) for x in ([s.level_hit for s in scores], [s.repairs > 0 for s in scores]))
    return (f"{name:13s} {np.median(levels):7.3f} {held:7.3f} {np.nanmedian(slopes):8.3f} {np.nanmean(hits):7.3f} "
            f"{np.nanmean(dates):8.3f} {np.isnan(dates).mean():8.3f} {np.nanmedian(widths):7.1f} {found:7.3f}  "
            f"{models}")


def main() -> None:
    """Print the table, the repairs and the sixty nights."""
    histories = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    print(f"{histories} histories of each kind, {MISSED:.0%} of the nights missed, {OUTLIERS:.0%} outliers")
    print("kind            level    held    slope    held    date held  no date   width  false repairs  model used")
    for kind in KINDS:
        print(line_of(kind, judged(kind, histories)), flush=True)
    found, false = repairs(histories)
    print(f"one repair in each: found {found:.3f}; of those found, false {false:.3f}")
    few = max(histories // 5, 2)
    print(f"sixty nights, {few} of each: worst level, how often held, worst slope, days by which the date is off, held")
    for kind in BENDING:
        done = [(h, w, scored(h, w)) for h, w in (sixty_nights(kind, seed) for seed in range(few))]
        off = [abs((w.limit_date[0] - START) / DAY - h.day) if w.limit_date else np.inf for h, w, _ in done]
        level, slope = (max(abs(getattr(s, name)) for *_, s in done) for name in ("level", "slope"))
        level_held, date_held = (np.mean([getattr(s, name) for *_, s in done]) for name in ("level_hit", "date_hit"))
        print(f"{kind:17s} {level:7.3f} {level_held:7.3f} {slope:7.3f} {max(off):7.1f} {date_held:7.3f}", flush=True)


if __name__ == "__main__":
    main()
