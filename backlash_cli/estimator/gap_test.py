"""Does the memory of a gap explain PV beyond all that past PV and OP explain? One Predictor, many gaps.

A stem behind a dead band d stands at play(OP, d): it lags behind OP by g = play(OP, d) - OP. If the valve has such a
gap, PV answers g exactly as it answers OP. So for each d the answer to OP is fitted with g added to OP (tied), the
answer to g alone is predicted with it, and this one column is offered to a prediction that has everything linear
already (the J test of nested and non-nested models, Davidson and MacKinnon, Econometrica 49 (1981) 781):

    gain       n/2 ln(loss without / loss with the column), in nats
    share      its coefficient: 1 where PV answers the gap as it answers OP, 0 where it does not answer it
    deviation  of the share, from sums over stretches of the record, so that one event does not pass for many
    tied       the gain of the tied fit over the prediction without a gap: below zero where the gap alone does worse
               than OP itself, which no valve does

Gaps that forget are offered as imitations: shaped alike, but rate dependent, as no valve is. What they gain is what
the imperfection of the prediction is worth.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from ..record import FloatArray
from .predictor import Predictor

STRETCHES = 24  # of the record, for the deviation of the share
LEAST_SHARE, MOST_SHARE = 0.6, 1.6  # a share outside is no gap, whatever it gains
LEAST_ANSWER, MOST_ANSWER = 0.02, 20.0  # of PV to OP within 6 Ti, times K: a loop so far off would not have been tuned
FREE_LAGS = 4  # of an imitation
NO_ANSWER, UNKNOWN = 1e-9, 1e6  # of the loss: PV answers less to a gap that OP never crossed; deviation of its share
TIED_COUNTS = 0.1  # of what the tied fit loses; loads that swing lose hundreds of nats there, valves few
IMITATED = 0.5  # of what imitations gain is taken off
SCALES = (0.5, 2.0, 8.0)  # memory of the imitations, in integral times


@dataclass(frozen=True)
class GapTest:
    """What each of the `widths` (widths,) brings; see the module. possible: the answer has the process's sign and a
    possible size. error_reduction: share of the prediction error variance that the gap removes."""

    widths: FloatArray
    gain: FloatArray
    share: FloatArray
    deviation: FloatArray
    tied: FloatArray
    possible: FloatArray
    error_reduction: FloatArray

    @property
    def fit(self) -> FloatArray:
        """Gain (widths,) where the share is about 1, else -1; what the tied fit loses is held against it."""
        full = (self.share > LEAST_SHARE) & (self.share < MOST_SHARE)
        held: FloatArray = np.where(full, self.gain + TIED_COUNTS * np.minimum(self.tied, 0.0), -1.0)
        return held

    @property
    def answer(self) -> FloatArray:
        """The same where the answer is a possible one as well: what counts as evidence."""
        return np.where(self.possible, self.fit, -1.0)


def gaps_in(output: FloatArray, widths: FloatArray, size: int) -> FloatArray:
    """How far the stem lags behind OP in gaps of `widths`, in its units: block means (widths, blocks)."""
    from ..kernels import gap_means

    return np.asarray(gap_means(output, widths, size, len(output) // size))


def forgetting_gaps_in(output: FloatArray, widths: FloatArray, size: int, memory: float) -> FloatArray:
    """The same of gaps that forget within SCALES of `memory` [samples], (widths times scales, blocks)."""
    from ..kernels import forgetting_gap_means

    rates = np.minimum(1.0, 1.0 / (np.array(SCALES) * memory))
    means = forgetting_gap_means(output, widths, rates, size, len(output) // size)
    return np.asarray(means.reshape(-1, means.shape[-1]))


def gaps_tested(p: Predictor, gaps: Sequence[FloatArray], widths: FloatArray, K: float | None, Ti: float,
                interval: float) -> GapTest:
    """Test gaps of `widths` (in the units of OP). gaps: `gaps_in` each recording, in the blocks of the prediction.

    K: controller gain [OP units / PV units], None when not known. Ti, interval: integral time, sampling interval [s].
    """
    G = p.lagged(gaps)
    H, w, n, at = p.columns, p.weights, p.rows, p.past_output
    floor = p.loss - float(w @ p.error**2)
    cross, own, solved = _beside(p, G)
    gram = np.repeat(p.gram[None], len(widths), axis=0)
    gram[:, at] += np.swapaxes(cross, 1, 2)
    gram[:, :, at] += cross
    gram[:, at, at] += own
    right = np.repeat((H @ (w * p.target))[None], len(widths), axis=0)
    right[:, at] += G @ (w * p.target)
    b: FloatArray = np.asarray(np.linalg.solve(gram, right[..., None])[..., 0], dtype=np.float64)
    left = float(w @ p.target**2) - np.sum(b * right, axis=1) + floor
    to_output = b[:, at]
    unexplained = own - np.swapaxes(cross, 1, 2) @ solved
    size = np.sum(to_output * (unexplained @ to_output[..., None])[..., 0], axis=1)
    answered = size > NO_ANSWER * p.loss
    size = np.where(answered, size, 1.0)
    found = np.where(answered, np.sum(to_output * (G @ (w * p.error)), axis=1), 0.0)
    share = found / size
    column = (to_output[:, None] @ G)[:, 0] - (solved @ to_output[..., None])[..., 0] @ H
    begins = -(-np.arange(STRETCHES) * n // STRETCHES)
    sums = np.add.reduceat(column * w * (p.error - share[:, None] * column), begins, axis=1)
    possible = np.array([LEAST_SHARE < x < MOST_SHARE and _possible(p, own_b, K, Ti, interval)
                         for x, own_b in zip(share, b, strict=True)])
    gain = -0.5 * n * np.log(np.maximum(1.0 - share * found / p.loss, 1e-9))
    deviation = np.where(answered, np.sqrt(np.sum(sums**2, axis=1)) / size, UNKNOWN)
    return GapTest(widths, gain, share, deviation,
                   0.5 * n * np.log(p.loss / np.maximum(left, 1e-300)), possible, share * found / p.loss)


def together(tests: Sequence[GapTest]) -> GapTest:
    """The same widths tested in several recordings, each with a prediction of its own: gains add up.

    The share is the mean of theirs, weighed by how well each is known; an answer is possible where that of most of the
    gain is.
    """
    if len(tests) == 1:
        return tests[0]
    gain = np.array([t.gain for t in tests])
    weight = 1.0 / np.maximum(np.array([t.deviation for t in tests]), 1e-6) ** 2
    share = np.sum(weight * np.array([t.share for t in tests]), axis=0) / weight.sum(0)
    possible = np.sum(gain * np.array([t.possible for t in tests]), axis=0) > 0.5 * gain.sum(0)
    reduction = np.mean([t.error_reduction for t in tests], axis=0)
    return GapTest(tests[0].widths, gain.sum(0), share, weight.sum(0) ** -0.5,
                   np.sum([t.tied for t in tests], axis=0), possible, reduction)


def free_gains(p: Predictor, signals: Sequence[FloatArray]) -> FloatArray:
    """Gain [nats] (signals,) of each of the signals (signals, blocks) of each recording with FREE_LAGS free lags."""
    G = p.lagged(signals, min(FREE_LAGS, p.lags.count))
    cross, own, solved = _beside(p, G)
    left = own - np.swapaxes(cross, 1, 2) @ solved
    diagonal = np.einsum("gii->gi", left)  # a view
    diagonal *= 1.0 + 1e-6
    diagonal += 1e-9
    right = G @ (p.weights * p.error)
    gained = np.sum(right * np.linalg.solve(left, right[..., None])[..., 0], axis=1)
    return np.asarray(-0.5 * p.rows * np.log(np.maximum(1.0 - gained / p.loss, 1e-9)))


def _beside(p: Predictor, G: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Weighted products of signals G (signals, lags, rows) with the columns, (signals, columns, lags), and with
    themselves (signals, lags, lags); and the columns' coefficients of each lag, (signals, columns, lags)."""
    signals, lags, rows = G.shape
    cross = np.moveaxis(((p.columns * p.weights) @ G.reshape(-1, rows).T).reshape(-1, signals, lags), 1, 0)
    return cross, (G * p.weights) @ np.swapaxes(G, 1, 2), p.inverse @ cross


def _possible(p: Predictor, b: FloatArray, K: float | None, Ti: float, interval: float) -> bool:
    """True where PV's answer to the gap is one of a process that this controller could control."""
    blocks = max(2, round(Ti / (p.size * interval)))
    impulse = np.zeros(6 * blocks + 1)
    impulse[0] = 1.0
    to_output, to_past = p.lags.spread(b[p.past_output]), p.lags.spread(b[p.past_measurement])
    to_past[0] += b[p.last_measurement].sum()  # its last moments are PV's past as well
    with np.errstate(over="ignore", invalid="ignore"):  # an unstable fit runs away, and is no process
        answer = np.cumsum(np.clip(np.nan_to_num(lfilter(np.append(0.0, to_output), np.append(1.0, -to_past), impulse)),
                                   -1e6, 1e6))
    if K is None:
        sign = np.sign(answer[np.argmax(np.abs(answer))])
        return bool(sign * answer[3 * blocks] > 0.0)
    answer = answer * K
    top = float(answer.max())
    return bool(top > abs(float(answer.min())) and LEAST_ANSWER < top < MOST_ANSWER and answer[3 * blocks] > 0.0)
