"""Where the stem stood in its gap when a record began.

A dead band is only seen once OP has covered it. Until then the stem may stand anywhere between half a gap above the
first OP and half a gap below; the middle is taken, and is as likely wrong as right. In one long record that matters
little. In recordings of an hour or two, pooled, OP may cover a gap of 2 % late in each of them or never, and the wrong
middle then speaks against wide gaps: on such simulated loops the size came out 11 % low, on one real valve 30 %. So
for each run of samples without a hole other starts are tried, and one is taken where PV clearly asks for it.

With the start at x0, and OP between low and high so far, the stem stands at x0 held between high - d/2 and low + d/2
as long as high - low < d, and from then on where it would stand whatever the start.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..record import FloatArray
from .criteria import MOTION
from .evidence import Evidence, weigh
from .fitter import Fitter
from .likelihood import T_FREEDOM
from .rows import Rows, begins

PLACES = (-1.0, -0.5, 0.5, 1.0)  # where in its gap a stem may stand, besides the middle: in half gaps
CLEARLY = 2.0  # nats by which another place must explain PV better than the middle: it was chosen among five
LEAST_ROWS = 0.005  # share of rows for which the place matters; below, the middle is as good
PASSES = 3  # over several runs: where the stem stood in one says what the process does in all
OF_A_STEP = 8.0  # nats: what a load step brings at least, true or not (STEP_LIMIT squared over two)
WITHIN = 6.0  # nats from the top: widths further down stay out of the interval whatever the start


def weigh_with_stem(rows: Rows, found: Evidence) -> Evidence:
    """Return the evidence in `rows` with the stem where PV says it stood, `found` where that explains PV no better.

    found: the evidence with the stem in the middle. Places and process model are looked for in turn.
    """
    best = now = found
    several = rows.stem is not None and bool(np.ptp(rows.stem[0]) > 0)
    for _ in range(PASSES if several else 1):
        placed = with_stem_placed(rows, now)
        if placed is None:
            break
        now = weigh(placed)
        if now.level - best.level > CLEARLY + OF_A_STEP * (now.steps - best.steps):
            best = now
    return best


def with_stem_placed(rows: Rows, found: Evidence) -> Rows | None:
    """Return `rows` with the stem where PV says it stood at the start of each run; None where nothing asks for it.

    found: the evidence in `rows` with the stem in the middle.
    """
    if rows.stem is None or len(found.shock) != len(rows.y):
        return None
    _, start, low, high = rows.stem
    unknown = np.mean((high - low)[:, None] < rows.widths, axis=0)
    widest = float(high.max() - low.min()) / MOTION
    asked = np.flatnonzero((unknown > LEAST_ROWS) & (rows.widths <= widest))
    if not len(asked):
        return None
    fit = Fitter(rows)
    fit.shock = found.shock
    run = np.unique(rows.stem[0], return_inverse=True)[1]
    stretch = begins(rows.first)
    places, heights = zip(*found.profile, strict=True)
    x, useful = rows.x.copy(), False
    for j in asked.tolist():
        shifts = [placed_at(place, float(rows.widths[j]), start, low, high) for place in PLACES]
        tried = np.stack([x[1 + j], *(x[1 + j] + s - s[stretch] for s in shifts)])
        levels = _levels(fit, np.array(found.shape), tried, run)
        best = np.where(levels[1:].max(axis=0) > levels[0] + CLEARLY, 1 + levels[1:].argmax(axis=0), 0)
        gained = float((levels.max(axis=0) - levels[0])[best > 0].sum())
        x[1 + j] = tried[best[run], np.arange(len(run))]
        height = float(np.interp(rows.widths[j], places, heights))
        useful |= gained > 0.0 and height + gained > max(found.gain, 0.0) - WITHIN
    return replace(rows, x=x) if useful else None


def placed_at(place: float, d: float, start: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """How far from where it would stand after a start in the middle the stem stands (rows,).

    place: where it started, in half gaps. d: dead band. start, low, high (rows,): first OP of the run, lowest and
    highest so far.
    """
    half = 0.5 * d
    bottom, top = high - half, np.maximum(low, high - d) + half  # the same once OP has covered the gap
    shift: FloatArray = np.clip(start + place * half, bottom, top) - np.clip(start, bottom, top)
    return shift


def _levels(fit: Fitter, p: FloatArray, tried: FloatArray, run: NDArray[np.intp]) -> FloatArray:
    """Log-likelihood (places, runs) of each run's rows for each of the valve positions `tried` (places, rows)."""
    found = []
    for i in range(0, len(tried), 2):
        two = tried[i : i + 2]
        noise = fit.pair(p, *two)[1]
        for c in range(len(two)):
            of_row = (T_FREEDOM + 1.0) * np.log1p(fit.R[c] ** 2 / (T_FREEDOM * noise[c])) + np.log(fit.S * noise[c])
            found.append(-0.5 * np.bincount(run, np.where(fit.counted, of_row, 0.0)))
    return np.array(found)
