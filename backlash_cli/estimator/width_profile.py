"""How well PV is explained by gaps of each width: where the best one is, how well it is known, and what to report; and
which widths a record excludes.

A dead band of L is excluded where gaps of L and more, as far as OP moved enough to tell, would have shown, had PV
answered them as it answers OP, and where the chance that one hides all the same is small. That chance is calibrated on
strange plants, a third of whose valves have play (`python -m tests.benchmarks.exclusion` fits it anew)."""

from collections.abc import Sequence

import numpy as np
import scipy

from ..record import FloatArray
from ..results import Confirmation
from .criteria import MOTION
from .gap_test import GapTest

NARROWEST = 0.4  # % of span: the narrowest width tried
TURN = 0.9  # of the range of OP: wider gaps were never crossed in both directions
TRACE, DROP = 3.0, 1.92  # nats: of evidence, a trace of a gap; of a likelihood, 95 %
LIMITS = (0.8, 1.1, 1.5, 2.0, 2.8, 4.0, 5.6)  # % of span: the limits of detection that are told apart
SMALLER = 0.85  # widths from this share of L on
MOVED = 2.0  # range of OP over a dead band that it excludes
WEIGHTS, CONSTANT = (1.725, -1.111, 0.359, -0.353, 0.808), -2.871  # of the signs, by regression
HIDDEN = 0.02  # chance that is left when a dead band is said to be excluded


def about(widths: FloatArray, j: int, count: int) -> FloatArray:
    """Up to `count` widths between the neighbours of number j, without that one."""
    fine = np.geomspace(widths[max(j - 1, 0)], widths[min(j + 1, len(widths) - 1)], count + 2)[1:-1]
    return np.asarray(fine[np.abs(fine / widths[j] - 1.0) > 1e-3])


def peak_of(widths: FloatArray, answer: FloatArray) -> float:
    """Width at the top of the parabola in log width through the best one and its neighbours."""
    j = int(answer.argmax())
    if 0 < j < len(widths) - 1 and min(answer[j - 1], answer[j + 1]) > 0.0:
        at = np.log(widths[j - 1 : j + 2])
        a, b, _ = np.polyfit(at - at[1], answer[j - 1 : j + 2], 2)
        if a < 0.0:
            return float(np.exp(np.clip(at[1] - 0.5 * b / a, at[0], at[2])))
    return float(widths[j])


def width_interval(widths: FloatArray, answer: FloatArray, d: float, least: float, doubt: float = 0.0
                   ) -> tuple[float, float]:
    """Ends of the widths whose answer is within DROP and `doubt` nats of the best, at least `least` of d each way."""
    j = int(answer.argmax())
    level = float(answer[j]) - DROP - doubt
    ends = []
    for way in (-1, 1):
        k = j
        while 0 <= k + way < len(widths) and answer[k + way] >= level:
            k += way
        beyond = k + way
        if 0 <= beyond < len(widths):
            above, below = answer[k] - level, level - answer[beyond]
            ends.append(float(widths[k] + (widths[beyond] - widths[k]) * above / max(above + below, 1e-12)))
        else:
            ends.append(float(widths[k]))
    return max(min(ends[0], d * (1.0 - least)), 0.0), max(ends[1], d * (1.0 + least))


def confirmation(d: float, interval: tuple[float, float], reduction: float, limit: float | None,
                 details: dict[str, float | str], widths: FloatArray, answer: FloatArray) -> Confirmation:
    """The Confirmation of what was found in % of span, in spans. details: with `evidence` [nats] and `rows`."""
    profile = tuple((float(w) / 100.0, float(v)) for w, v in zip(widths, answer, strict=True))
    return Confirmation(d / 100.0, (interval[0] / 100.0, interval[1] / 100.0), reduction,
                        2.0 * float(details["evidence"]) - float(np.log(float(details["rows"]))),
                        None if limit is None else limit / 100.0, details, profile)


def signs(tests: Sequence[GapTest], evidence: float, length: float, moved: float) -> FloatArray:
    """What speaks for a dead band of L or more, for each L of LIMITS, (limits, 6): in the order of `WEIGHTS`, and the
    nats that a gap of L would have brought.

    tests: of each block length. evidence: of the record [nats]; length: in integral times; moved: how far OP did [% of
    span]. Signs: what gaps of L and more explain in the mean over block lengths, by how much one of these is above that
    at most, whatever the width, and the evidence, these as sign times log1p; logs of length and of moved over L."""
    widths, limits = tests[0].widths, np.array(LIMITS)
    gains = np.array([test.gain for test in tests])
    mean = gains.mean(axis=0)
    there = widths >= SMALLER * limits[:, None]
    there[:, -1] = True
    nearest = np.abs(np.log(widths / limits[:, None])).argmin(axis=1)
    told = np.column_stack([np.where(there, mean, -np.inf).max(axis=1), np.full(len(limits), (gains - mean).max()),
                            np.full(len(limits), evidence)])
    nats = np.sort(0.5 / np.maximum([test.deviation for test in tests], 1e-6) ** 2, axis=0)
    expected = nats[-2:].mean(axis=0)[nearest]  # as evidence is, of the two block lengths that show it best
    return np.column_stack([np.sign(told) * np.log1p(np.abs(told)), np.full(len(limits), np.log(max(length, 1.0))),
                            np.log(moved / limits), expected])


def chance_hidden(signs: FloatArray) -> FloatArray:
    """Chance (rows,) that a dead band hides behind such signs (rows, 5)."""
    return np.asarray(scipy.special.expit(signs @ np.array(WEIGHTS) + CONSTANT))


def excluded(tests: Sequence[GapTest], evidence: float, length: float, moved: float) -> float | None:
    """The smallest of LIMITS [% of span] from which on no dead band hides in the record; None where there is none."""
    found, limits = signs(tests, evidence, length, moved), np.array(LIMITS)
    shown = found[:, -1] >= DROP
    hidden = (chance_hidden(found[:, :-1]) > HIDDEN) | (~shown & (MOTION * limits <= moved))
    beyond = int(np.append(-1, np.flatnonzero(hidden))[-1]) + 1
    return LIMITS[beyond] if beyond < len(limits) and (shown & (MOVED * limits <= moved))[beyond] else None
