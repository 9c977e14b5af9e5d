"""Parts of a long record first, those with the most motion of OP: where they decide, the rest needs no weighing.

A part decides where it excludes every dead band, or where it shows one so clearly that the rest would not change its
size. What was found in one part is where the search in the next, larger one begins.
"""

from __future__ import annotations

import numpy as np

from .best_models import Models, first_models, further_models
from .evidence import Evidence, weigh, weighed
from .fitter import Fitter
from .rows import Rows, counted, liveliest, part_of

PARTS = (500, 1000)  # rows: with a dead band of evidence 8 in 2,000 rows, 2 are left in 500
LONG = 1500  # rows; for shorter records the parts cost more than they save
EXCLUDED = 6.0  # nats by which every width must lie behind: the same that the limit of detection asks for
STEP_ROWS = 40  # rows (ten Ti) per load step; where it steps more often, single steps are a poor model of the load
ENOUGH = 1000  # rows: on simulated days 500 give the size with twice the error of all 2,000, 1,000 with the same
SHOWN, SHOWN_PER_STEP = 16.0, 2.0  # nats: twice what a verdict asks for (criteria.EVIDENCE)
KNOWN = 0.1  # half interval of the likelihood over d: beyond, more rows still make it narrower
SMOOTH = 0.0  # logit phi: more than half of a move of the load is left a row later, as behind a stem in its gap
UNPLACED = 0.05  # share of rows before OP has covered the gap: with more, it matters where the stem stood at first


def weigh_lightly(rows: Rows) -> Evidence:
    """Return the evidence of a part of the rows where it decides, of all of them where it does not."""
    if len(rows.y) < LONG:
        return weigh(rows)
    shock = np.zeros(len(rows.y))
    m: Models | None = None
    for most in PARTS:
        use = liveliest(rows, most)
        part = part_of(rows, use)
        if 2 * counted(part.first).sum() <= len(use):
            continue
        fit = Fitter(part, shock[use])
        m = first_models(fit) if m is None else further_models(fit, m)
        may_show = most >= ENOUGH and m.gain > 0.5 * _asked(int(np.count_nonzero(fit.shock)))
        if m.gain < -EXCLUDED or may_show:
            found = weighed(fit, m)
            if excludes(found) or (may_show and shows(found) and _covered(part, found.d)):
                return found
        shock[use] = fit.shock
    if m is None:
        return weigh(rows)
    fit = Fitter(rows, shock)
    found = weighed(fit, further_models(fit, m))
    clear = found.gain > max(_asked(found.steps), found.half) or (_highest(found) < -EXCLUDED and not _smooth(found))
    if clear or not (_smooth(found) or 0 < found.steps * STEP_ROWS <= found.rows):
        return found
    # load steps of a part, or a smooth load, may have led astray
    return max(found, weigh(rows), key=lambda e: e.worth)


def excludes(e: Evidence) -> bool:
    """Whether every width lies behind none, although PV answers to OP."""
    lies_behind = _highest(e) < -EXCLUDED < EXCLUDED < e.responds
    return lies_behind and e.steps * STEP_ROWS <= e.rows and not _smooth(e)


def shows(e: Evidence) -> bool:
    """Whether there is a dead band beyond doubt, and its size known as well as the model of the process allows."""
    low, high = e.interval
    return e.gain > max(_asked(e.steps), e.half) and high - low < 2.0 * KNOWN * e.d


def _smooth(e: Evidence) -> bool:
    """Whether without a dead band a smooth load is asked for: a part of the rows does not tell it from a dead band."""
    return e.shape_without[2] > SMOOTH


def _highest(e: Evidence) -> float:
    return max(v for _, v in e.profile)


def _covered(rows: Rows, d: float) -> bool:
    """Whether OP has covered a dead band of d since each start, so that it does not matter where the stem stood."""
    return rows.stem is None or float(np.mean(rows.stem[3] - rows.stem[2] < d)) <= UNPLACED


def _asked(steps: int) -> float:
    return SHOWN + SHOWN_PER_STEP * steps
