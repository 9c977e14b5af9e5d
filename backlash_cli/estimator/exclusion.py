"""Which dead bands does a record exclude? The smallest one that would not have hidden in it.

A loop without a sign of a dead band may still have one. A dead band of L is excluded where two things hold for all
widths from L on: PV answers such gaps clearly less than it answers OP, and the chance that one hides all the same is
small. That chance is calibrated on plants that share nothing with the test, a third of whose valves have play
(`python -m tests.benchmarks.exclusion` fits it anew).
"""

from collections.abc import Sequence

import numpy as np
from scipy.special import expit

from ..record import FloatArray
from .gap_test import IMITATED, GapTest

LIMITS = (0.8, 1.1, 1.5, 2.0, 2.8, 4.0, 5.6)  # % of span: the limits of detection that are told apart
SMALLER, BEYOND = 0.85, 1.2  # widths from this share of L on, up to the range of OP over this
COUNTED = 0.5  # of the rows; wider gaps, which the record hardly knows, show in narrower ones as well
FULL, SHORT_OF = 0.8, 1.0  # share of a gap that is there, less what the test loses; deviations it is short of
BEST = 2  # block lengths that count for the gain
WEIGHTS, CONSTANT = (0.285, -0.217, 0.078, -0.492, 1.042, -0.082, -0.215), -2.067  # of the signs, by regression
HIDDEN = 0.02  # chance that is left when a dead band is said to be excluded
STRANGE = 60.0  # nats that an imitation gains where the prediction is plainly wrong, as under a load that switches


def signs(tests: Sequence[tuple[GapTest, float]], length: float, span: float) -> FloatArray:
    """What speaks for a dead band of L or more, for each L of LIMITS, (limits, 8): in the order of `WEIGHTS`, and how
    far PV's answer falls short.

    tests: of each block length, with what its best imitation gained. length: of the record in integral times. span (of
    OP): % of span. The signs are the net gain of free answers in the two best block lengths, by how many deviations
    PV's share in the gap is short of full and the tied gain (medians over block lengths), these three as sign times
    log1p; and the logs of length, span over L, L, and the share's deviation. The last is the shortfall as it is.
    """
    widths, limits = tests[0][0].widths, np.array(LIMITS)
    known = (widths <= span / BEYOND) & (tests[0][0].counted > COUNTED)
    there = known & (widths >= SMALLER * limits[:, None])
    there[~there.any(axis=1), np.flatnonzero(known)[-1] if known.any() else -1] = True
    kept = np.where(there, 0.0, np.nan)[:, None]  # (limits, 1, widths)
    free, tied, share, deviation = (np.array([getattr(t, name) for t, _ in tests]) + kept
                                    for name in ("free", "tied", "share", "deviation"))
    net = np.sort(np.nanmax(free, axis=2) - IMITATED * np.array([imitated for _, imitated in tests]), axis=1)
    short = np.median(np.nanmin((FULL - share) / np.maximum(deviation, 0.02), axis=2), axis=1)
    known = np.maximum(np.median(np.nanmedian(deviation, axis=2), axis=1), 1e-3)
    told = [np.sign(x) * np.log1p(np.abs(x)) for x in (net[:, -BEST:].sum(axis=1) / BEST, short,
                                                       np.median(np.nanmax(tied, axis=2), axis=1))]
    return np.column_stack([*told, np.full(len(limits), np.log(max(length, 1.0))), np.log(span / limits),
                            np.log(limits), np.log(known), short])


def chance_hidden(signs: FloatArray) -> FloatArray:
    """Chance (rows,) that a dead band hides behind such signs (rows, 7)."""
    return np.asarray(expit(signs @ np.array(WEIGHTS) + CONSTANT))


def excluded(tests: Sequence[tuple[GapTest, float]], length: float, span: float) -> float | None:
    """The smallest of LIMITS [% of span] from which on no dead band hides in the record; None where there is none."""
    if max(imitated for _, imitated in tests) > STRANGE:
        return None
    found = signs(tests, length, span)
    hidden = (chance_hidden(found[:, :-1]) > HIDDEN) | (found[:, -1] < SHORT_OF)
    if hidden[-1]:
        return None
    return LIMITS[0 if not hidden.any() else int(np.flatnonzero(hidden)[-1]) + 1]
