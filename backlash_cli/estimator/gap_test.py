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
    free       the gain with an answer of its own, in few lags, where that is one of a process; else -1

In a loop that nothing moves but its load, OP is made of past PV alone: what PV answers to OP cannot be told from what
the load does next, and a gap tied to that reads low. An answer of its own shows it there, and proves less elsewhere.

Until OP has covered the gap since a recording began, nobody knows where the stem stands in it: what lies before does
not count, neither for the gap nor against it. In many short recordings of one loop that is much.

Gaps that forget are offered as imitations: shaped alike, but rate dependent, as no valve is. What they gain is what
the imperfection of the prediction is worth."""

from collections.abc import Sequence

import numpy as np

from ..record import BoolArray, FloatArray, Frozen, IntArray
from .predictor import LEAST_ROWS, Predictor

COVERED = 0.9  # of a gap by OP: from there on it is known well enough where the stem stands
STRETCHES = 24  # of the record, for the deviation of the share
LEAST_SHARE, MOST_SHARE = 0.6, 1.6  # a share outside is no gap, whatever it gains
LEAST_ANSWER, MOST_ANSWER = 0.02, 20.0  # of PV to OP within 6 Ti, times K: a loop so far off would not have been tuned
ANSWERED = 8.5  # nats that past OP must tell of PV: of 300 valves that never moved it told so much of one
FREE_LAGS = 4  # of an answer of its own, to a gap or to an imitation
SEEN_TIED, SEEN_FREE = (6, 3), (3, 1)  # Ti: how long an answer is watched, when it must have come; few lags tell less
NO_ANSWER, UNKNOWN = 1e-9, 1e6  # of the loss: PV answers less to a gap that OP never crossed; deviation of its share
TIED_COUNTS = 0.1  # of what the tied fit loses; loads that swing lose hundreds of nats there, valves few
SCALES = (0.5, 2.0, 8.0)  # memory of the imitations, in integral times


class GapTest(Frozen):
    """What each of the `widths` (widths,) brings; see the module. possible: the answer has the process's sign and a
    possible size. error_reduction: share of the prediction error variance that the gap removes. counted: of rows."""

    widths: FloatArray
    gain: FloatArray
    share: FloatArray
    deviation: FloatArray
    tied_gain: FloatArray
    possible: BoolArray
    error_reduction: FloatArray
    counted: FloatArray
    free: FloatArray

    @property
    def fit(self) -> FloatArray:
        """Gain (widths,) where the share is about 1, else -1; what the tied fit loses is held against it."""
        return np.asarray(np.where(full(self.share), self.gain + TIED_COUNTS * np.minimum(self.tied_gain, 0.0), -1.0))

    @property
    def answer(self) -> FloatArray:
        """The same where the answer is a possible one as well: what counts as evidence."""
        return np.where(self.possible, self.fit, -1.0)


def full(share: FloatArray) -> BoolArray:
    """Where PV answers the gap about as it answers OP."""
    return (share > LEAST_SHARE) & (share < MOST_SHARE)


def gaps_in(output: FloatArray, widths: FloatArray, size: int) -> FloatArray:
    """How far the stem lags behind OP in gaps of `widths`, in its units: block means (widths, blocks)."""
    from ..kernels import gap_means
    return np.asarray(gap_means(output, widths, size, len(output) // size))


def stem_known(output: FloatArray, widths: FloatArray) -> IntArray:
    """Samples (widths,) by which OP has covered the gap: from there on the stem stands where the gap says."""
    covered = np.maximum.accumulate(output) - np.minimum.accumulate(output)
    return np.searchsorted(covered, COVERED * widths)


def forgetting_gaps_in(output: FloatArray, widths: FloatArray, size: int, memory: float) -> FloatArray:
    """The same of gaps that forget within SCALES of `memory` [samples], (widths times scales, blocks)."""
    from ..kernels import forgetting_gap_means
    rates = np.minimum(1.0, 1.0 / (np.array(SCALES) * memory))
    means = forgetting_gap_means(output, widths, rates, size, len(output) // size)
    return np.asarray(means.reshape(-1, means.shape[-1]))


def gaps_tested(p: Predictor, gaps: Sequence[FloatArray], known: Sequence[IntArray], widths: FloatArray,
                K: float | None, Ti: float, interval: float) -> GapTest:
    """Test gaps of `widths` (in the units of OP). gaps: `gaps_in` each recording, in the blocks of the prediction.

    known: `stem_known` in each recording. K: controller gain [OP units / PV units], None when not known. Ti, interval:
    integral time, sampling interval [s]. The prediction is fitted anew to the rows that count for each gap."""
    H, y, at, counts = p.columns, p.target, p.past_output, p.since(known)
    G, few = p.lagged(gaps), slice(0, FREE_LAGS)
    cross, own = _beside(p, G)
    own_gain, own_answer, beside = _free_answers(p, cross[..., few], own[:, few, few], G[:, few] @ p.error)
    own_gain = np.where(_possible(p, beside, own_answer, K, Ti, interval, SEEN_FREE), own_gain, -1.0)
    base = np.repeat(p.gram[None], len(G), axis=0)
    for g in np.flatnonzero(~counts.all(axis=1)):  # without the rows that do not count
        before, early = H[:, ~counts[g]], G[g][:, ~counts[g]]
        for products, one, other in ((base, before, before), (cross, before, early), (own, early, early)):
            products[g] -= one @ other.T
        np.einsum("ii->i", base[g])[:] -= p.blur * np.einsum("cr,cr->c", before, before)
        G[g] *= counts[g]
    degrees, blur = counts.sum(axis=1) - len(H), p.blur[at.start] * base[:, at.start, at.start]  # of freedom; of OP
    to_columns = (counts * y) @ H.T
    solved = np.linalg.solve(base, np.concatenate([cross, to_columns[..., None]], axis=2))
    solved, alone = solved[..., :-1], solved[..., -1]
    error, most = counts * (y - alone @ H), counts @ y**2 + p.floor * (counts @ p.weights) / np.sum(p.weights)
    loss = np.maximum(most - np.sum(alone * to_columns, axis=1), NO_ANSWER * p.loss)  # no row may count
    gram, right = base, to_columns  # they become those of the tied fit
    gram[:, at] += np.swapaxes(cross, 1, 2)
    gram[:, :, at] += cross
    gram[:, at, at] += own
    right[:, at] += G @ y
    b: FloatArray = np.asarray(np.linalg.solve(gram, right[..., None])[..., 0], dtype=np.float64)
    left = most - np.sum(b * right, axis=1)
    to_output = b[:, at]
    unexplained = own - np.swapaxes(cross, 1, 2) @ solved
    np.einsum("gii->gi", unexplained)[:] += blur[:, None]
    size = np.sum(to_output * (unexplained @ to_output[..., None])[..., 0], axis=1)
    answered = (size > NO_ANSWER * loss) & (degrees >= LEAST_ROWS)
    size = np.where(answered, size, 1.0)
    found = np.where(answered, np.einsum("gl,glr,gr->g", to_output, G, error), 0.0)
    share = found / size
    column = (to_output[:, None] @ G)[:, 0] - counts * ((solved @ to_output[..., None])[..., 0] @ H)
    begins = -(-np.arange(STRETCHES) * len(y) // STRETCHES)
    sums = np.add.reduceat(column * (error - share[:, None] * column), begins, axis=1)
    gain = _gain(share * found / loss, degrees)
    # stretches agree with a share that was fitted to few of them: no less than what single rows leave
    variance = np.maximum(np.sum(sums**2, axis=1), size * loss / np.maximum(degrees, 1))
    deviation = np.where(answered, np.sqrt(variance) / size, UNKNOWN)
    tied = np.where(answered, 0.5 * degrees * np.log(loss / np.maximum(left, NO_ANSWER * p.loss)), 0.0)
    possible = full(share) & _possible(p, b, to_output, K, Ti, interval, SEEN_TIED)
    return GapTest(widths, gain, share, deviation, tied, possible, share * found / loss, counts.mean(axis=1), own_gain)


def answers_output(predictions: Sequence[Predictor], K: float | None, Ti: float, interval: float) -> bool:
    """Whether past OP tells of PV, in the mean of the two block lengths where it tells most, and PV's answer to it is
    one of a process in one of them all. K, Ti, interval: as `gaps_tested`."""
    told, possible = [], False
    for p in predictions:
        at, b = p.past_output, p.coefficients[None]
        more = b[0, at] @ np.linalg.solve(np.linalg.inv(p.gram)[at, at], b[0, at])  # by how much the loss would grow
        told.append(0.5 * p.rows * float(np.log1p(more / p.loss)))
        possible |= bool(_possible(p, b, b[:, at], K, Ti, interval, SEEN_TIED)[0])
    return possible and float(np.mean(sorted(told)[-2:])) >= ANSWERED


def imitation_gains(p: Predictor, signals: Sequence[FloatArray]) -> FloatArray:
    """Gain [nats] (signals,) of each of the signals (signals, blocks) of each recording with FREE_LAGS free lags."""
    G = p.lagged(signals, min(FREE_LAGS, p.lags.count))
    return _free_answers(p, *_beside(p, G), G @ p.error)[0]


def _free_answers(p: Predictor, cross: FloatArray, own: FloatArray, right: FloatArray
                  ) -> tuple[FloatArray, FloatArray, FloatArray]:
    """What signals gain, each with an answer of its own, from products of their lags with the columns and themselves
    (`_beside`) and with the error of the prediction, right (signals, lags).

    Returns gains [nats] (signals,), coefficients of the lags (signals, lags), and of the columns (signals, columns)."""
    solved = np.linalg.solve(p.gram, cross)
    left = own - np.swapaxes(cross, 1, 2) @ solved
    diagonal = np.einsum("gii->gi", left)  # a view
    diagonal *= 1.0 + 1e-6
    diagonal += 1e-9 + p.blur[p.past_output.start] * p.gram[p.past_output.start, p.past_output.start]  # made of OP
    answer: FloatArray = np.asarray(np.linalg.solve(left, right[..., None]), dtype=np.float64)
    beside = p.coefficients - (solved @ answer)[..., 0]
    return _gain(np.sum(answer[..., 0] * right, axis=1) / p.loss, p.rows - len(p.columns)), answer[..., 0], beside


def _gain(share: FloatArray, degrees: FloatArray | int) -> FloatArray:
    """Nats by which a prediction with so many `degrees` of freedom is better without this share of its loss."""
    return np.asarray(-0.5 * degrees * np.log(np.maximum(1.0 - share, 1e-9)))


def _beside(p: Predictor, G: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Products of signals G (signals, lags, rows) with columns (signals, columns, lags), G (signals, lags, lags)."""
    signals, lags, rows = G.shape
    cross = np.moveaxis((p.columns @ G.reshape(-1, rows).T).reshape(-1, signals, lags), 1, 0)
    return cross, G @ np.swapaxes(G, 1, 2)


def _possible(p: Predictor, b: FloatArray, to_gap: FloatArray, K: float | None, Ti: float, interval: float,
              seen: tuple[int, int]) -> BoolArray:
    """(gaps,) where PV's answer to the gap, by coefficients b (gaps, columns) and to_gap (gaps, lags) of its lags, is
    one of a process that this controller could control. seen: as SEEN_TIED."""
    blocks = max(2, round(Ti / (p.size * interval)))
    to_past = p.lags.spread(b[:, p.past_measurement])
    to_past[:, 0] += b[:, p.last_measurement].sum(axis=1)  # its last moments are PV's past as well
    moved, back = np.cumsum(p.lags.spread(to_gap), axis=1), to_past.shape[1]
    held = moved.shape[1]
    answer = np.zeros((len(b), back + seen[0] * blocks + 1))  # to a step, after as many blocks without any
    for t in range(1, seen[0] * blocks + 1):
        known = np.einsum("gi,gi->g", to_past, answer[:, back + t - 1 : t - 1 : -1]) + moved[:, min(t, held) - 1]
        answer[:, back + t] = np.clip(known, -1e6, 1e6)  # an unstable fit runs away, and is no process
    answer = answer[:, back:]
    late = answer[:, seen[1] * blocks]
    if K is None:
        return np.asarray(np.where(answer.max(axis=1) > -answer.min(axis=1), late, -late) > 0.0)
    top, bottom = (answer * K).max(axis=1), (answer * K).min(axis=1)
    return np.asarray((top > -bottom) & (top > LEAST_ANSWER) & (top < MOST_ANSWER) & (late * K > 0.0))
