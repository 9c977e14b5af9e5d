"""Which dead bands does a record exclude? The smallest one that would not have hidden in it.

A dead band of L is excluded where gaps of L and more, as far as OP moved enough to tell, would have shown, had PV
answered them as it answers OP, and where the chance that one hides all the same is small. That chance is calibrated on
strange plants, a third of whose valves have play (`python -m tests.benchmarks.exclusion` fits it anew)."""

from collections.abc import Sequence

import numpy as np
from scipy.special import expit

from ..record import FloatArray
from .criteria import MOTION
from .gap_test import GapTest
from .width_profile import DROP

LIMITS = (0.8, 1.1, 1.5, 2.0, 2.8, 4.0, 5.6)  # % of span: the limits of detection that are told apart
SMALLER = 0.85  # widths from this share of L on
MOVED = 2.0  # range of OP over a dead band that it excludes
WEIGHTS, CONSTANT = (1.29, -0.867, 0.131, -0.566, 1.203), -2.496  # of the signs, by regression
HIDDEN = 0.015  # chance that is left when a dead band is said to be excluded


def signs(tests: Sequence[GapTest], evidence: float, length: float, moved: float) -> FloatArray:
    """What speaks for a dead band of L or more, for each L of LIMITS, (limits, 6): in the order of `WEIGHTS`, and the
    nats that a gap of L would have brought.

    tests: of each block length. evidence: of the record [nats]; length: in integral times; moved: how far OP did [% of
    span]. The signs are what gaps of L and more explain in the mean over block lengths, by how much one of these is
    above the mean at most, whatever the width, and the evidence, these three as sign times log1p; and the logs of
    length and of moved over L."""
    widths, limits = tests[0].widths, np.array(LIMITS)
    gains = np.array([test.gain for test in tests])
    mean = gains.mean(axis=0)
    there = widths >= SMALLER * limits[:, None]
    there[:, -1] = True
    nearest = np.abs(np.log(widths / limits[:, None])).argmin(axis=1)
    told = np.column_stack([np.where(there, mean, -np.inf).max(axis=1), np.full(len(limits), (gains - mean).max()),
                            np.full(len(limits), evidence)])
    expected = np.median([0.5 / np.maximum(test.deviation, 1e-6) ** 2 for test in tests], axis=0)[nearest]
    return np.column_stack([np.sign(told) * np.log1p(np.abs(told)), np.full(len(limits), np.log(max(length, 1.0))),
                            np.log(moved / limits), expected])


def chance_hidden(signs: FloatArray) -> FloatArray:
    """Chance (rows,) that a dead band hides behind such signs (rows, 5)."""
    return np.asarray(expit(signs @ np.array(WEIGHTS) + CONSTANT))


def excluded(tests: Sequence[GapTest], evidence: float, length: float, moved: float) -> float | None:
    """The smallest of LIMITS [% of span] from which on no dead band hides in the record; None where there is none."""
    found, limits = signs(tests, evidence, length, moved), np.array(LIMITS)
    shown = found[:, -1] >= DROP
    hidden = (chance_hidden(found[:, :-1]) > HIDDEN) | (~shown & (MOTION * limits <= moved))
    beyond = int(np.append(-1, np.flatnonzero(hidden))[-1]) + 1
    return LIMITS[beyond] if beyond < len(limits) and (shown & (MOVED * limits <= moved))[beyond] else None
