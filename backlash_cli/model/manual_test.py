"""A valve test in manual: PV against OP that a hand has moved, where nothing feeds back.

    manual_test(recordings, interval, K, Ti) -> Confirmation | Note          a Note says why it tells nothing

In automatic OP answers to PV, and only a prediction from the past may be compared (estimator/predictor.py). In manual
OP comes from outside, so that PV can be compared with what a whole model of the loop makes of it:

    PV = gain x answer(stem) + curvature x answer(stem squared) + load + noise,    stem = play(OP, d)

with one of some fifty answers (a lag, a second one, dead time, or an integrator beside which PV may drift) and the load
and noise of `noise.Whitener`. All is the same for d = 0, and the gain in likelihood is evidence: for normal errors and
for those with long tails, as a load that jumps at the right moment convinces one of the two at most."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import chain, combinations_with_replacement, compress, product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from ..effects.process import delayed_lag
from ..estimator.criteria import CALLED_TESTED, FEWEST_CROSSINGS, MOTION
from ..estimator.predictor import COMPLETE, FREEDOM, Recording, block_means
from ..estimator.width_profile import DROP, NARROWEST, TRACE, TURN, about, confirmation, peak_of, width_interval
from ..kernels import gap_crossings, play
from ..record import BoolArray, FloatArray, Frozen, Note
from ..results import Confirmation
from ..words import noted
from .noise import Noise, whitener

BLOCKS, FEWEST_BLOCKS, FOR_EACH_STEP = (400, 1000), 30, 20  # of block means of PV in all; coarse ones blur the steps
LEAST_MOTION = 1.5 * NARROWEST  # % of span: OP moved less is no test
LIMITS = np.geomspace(1.0, 10.0, 14)  # % of span: the limits of detection that are told apart
LAGS, LONGEST = 7, 0.25  # how many lags are tried, up to which part of the longest test
SECOND, DEAD_TIMES = (0.0, 0.6), (0.0, 0.5, 1.0)  # second lag and dead time as shares of the lag
WANDERS = (0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0)  # move of the load in a block over the noise
SMOOTH = (0.1, 2.0, 6.0, 20.0, 100.0)  # blocks over which its moves are smoothed; long where a tank adds up its load
FOREVER = 30.0  # times the test: what the load forgets
SCOUTS, KEPT = (0.25, 0.5, 0.75), 4  # dead bands of the first round as shares of the motion; models kept of each
FIRST = 4  # every so many of the answers tell which noises are worth trying with all
TRIALS, CLOSE, FARTHEST = 15, 1e-4, 3.0  # of a search from the best: rounds, tolerance, reach in logarithms
STARTS = (-1.0, 0.0, 1.0)  # place of the stem at the start, in half gaps
WIDTHS, APART, FINE = 14, 4, 7  # dead bands tried, every so many with answers of its own, and near the best
LEAST_INTERVAL = 0.15  # of d, each way: the process is never exactly one of the answers
SURE = 1.28  # deviations: 90 %
TURNED = 0.2  # of d: OP going back by more begins a new event
ROUNDS, FAR = 3, 10.0  # of the weights; nats below the best of every dead band, where a model is not worth them
ANSWERED = 6.0  # deviations from no answer: one that is too slow to be seen whole is still one
NO_ANSWER = 0.1  # gain of the loop, that of the controller included: no process that is controlled is weaker
LONG_ENOUGH = 2.0  # integral times of a test after which any would have answered


class Answer(Frozen):
    """How PV follows the stem: lag, second lag, dead time [s]; integrating: the lag is that of its rate."""

    lag: float
    second: float = 0.0
    delay: float = 0.0
    integrating: bool = False

    def of(self, stems: FloatArray, interval: float) -> FloatArray:
        """Answers (.., blocks) to stems (.., blocks) that are at rest before, gain 1."""
        x = np.apply_along_axis(delayed_lag, -1, stems, interval, self.lag, self.delay)
        if self.second > 0.0:
            x = np.apply_along_axis(delayed_lag, -1, x, interval, self.second, 0.0)
        return (np.cumsum(x, axis=-1) - x) * interval / self.lag if self.integrating else x


Model = tuple[Noise, Answer]


class _Blocks(Frozen):
    """Recordings in block means: outputs (samples,) less their mean; measurement, used (blocks,) of each."""

    outputs: tuple[FloatArray, ...]
    measurement: tuple[FloatArray, ...]
    used: tuple[BoolArray, ...]
    size: int
    interval: float
    moved: float

    def stems(self, d: float, start: float) -> list[FloatArray]:
        return [block_means(play(u, d, u[0] + 0.5 * start * d), self.size) for u in self.outputs]

    def crossings(self, d: float) -> int:
        """How often OP went back through a gap while the controller was in manual."""
        return sum(gap_crossings(u, d) - gap_crossings(u[: np.argmax(used) * self.size + 1], d)
                   for u, used in zip(self.outputs, self.used, strict=True))

    def events(self, least: float) -> NDArray[np.int64]:
        """Of each used block (rows,) the number of the stretch, between two turns of OP by more than `least`."""
        found, before = [], 0
        for u, used in zip(self.outputs, self.used, strict=True):
            stem = play(u, least, u[0])
            way = np.sign(np.diff(stem, prepend=stem[0]))
            moving = np.flatnonzero(way)
            turns = moving[1:][way[moving[1:]] != way[moving[:-1]]]
            number = before + np.searchsorted(turns, np.arange(len(used)) * self.size, side="right")
            found.append(number[used])
            before = int(number[-1]) + 1
        return np.concatenate(found)

    def columns(self, stems: Sequence[Sequence[FloatArray]], answers: Sequence[Answer]) -> list[FloatArray]:
        """Of each recording (blocks, 1 + (2 + recordings) * models): PV, and of each stem and answer what PV would be,
        the same for the square of the stem, and beside an integrator a drift of each recording's own."""
        found = []
        for i, y in enumerate(self.measurement):
            stem = np.array([several[i] for several in stems])
            both = np.stack([stem, stem * stem / self.moved])
            rows = np.zeros((2 + len(self.used), len(stems), len(answers), len(y)))
            for k, a in enumerate(answers):
                rows[:2, :, k] = a.of(both, self.interval)
                rows[2 + i, :, k] = np.arange(len(y)) / len(y) * a.integrating
            if self.size > 1:  # a block mean lies half a block after the block's first sample
                rows[:2, ..., :-1] = 0.5 * (rows[:2, ..., :-1] + rows[:2, ..., 1:])
            found.append(np.vstack([y, rows.reshape(-1, len(y))]).T)
        return found

    def whitened(self, noise: Noise, columns: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray, FloatArray]:
        """PV (rows,) and columns (rows, columns, models) of all models, whitened, used blocks only; weights (rows,)."""
        white = [whitener(noise, used, self.interval) for used in self.used]
        both = np.concatenate([w.columns(c)[used] for w, c, used in zip(white, columns, self.used, strict=True)])
        weights = np.concatenate([w.weight[used] for w, used in zip(white, self.used, strict=True)])
        return both[:, 0], both[:, 1:].reshape(len(both), 2 + len(self.used), -1), weights


class _Fits(NamedTuple):
    """Models of PV fitted to it: each (models,), coefficients (models, columns)."""

    normal: FloatArray
    student: FloatArray
    coefficients: FloatArray
    variance: FloatArray
    deviation: FloatArray


def manual_test(recordings: Sequence[Recording], interval: float, K: float | None = None, Ti: float | None = None
                ) -> Confirmation | Note:
    """Say what tests of a valve in manual tell of its dead band.

    recordings: one for each test, OP and PV in % of span, `usable` where the controller was in manual; what lies before
    tells where the stem stood. interval: of the samples [s]. K: controller gain [OP / PV], Ti: integral time [s], where
    known: the sign of the answer, and whether there should be one. Returns a Confirmation in spans; its details name
    the `source`, and the evidence (nats) left without the turn of OP that brings the most (`elsewhere`)."""
    if (data := _blocks(recordings, interval)) is None:
        return noted("manual_short", least=FEWEST_BLOCKS)
    if data.moved < LEAST_MOTION:
        return noted("manual_still", span=data.moved)
    if not any(np.ptp(y[used]) > 0.0 for y, used in zip(data.measurement, data.used, strict=True)):
        return noted("manual_constant")
    longest = max(map(np.count_nonzero, data.used)) * data.interval
    lags = np.geomspace(0.5 * data.interval, max(LONGEST * longest, data.interval), LAGS)
    answers = [Answer(float(lag), float(b * lag), float(c * lag)) for lag in lags for b in SECOND for c in DEAD_TIMES
               if (not b or lag > data.interval) and (not c or c * lag > 0.3 * data.interval)]
    answers += [Answer(float(lag), 0.0, float(c * lag), True) for lag in lags[::2] for c in DEAD_TIMES]
    slow = FOREVER * longest
    noises = [Noise(w * float(np.sqrt(0.5 * slow / data.interval)), slow, s * data.interval)
              for w in WANDERS for s in SMOOTH]
    scouts = [data.stems(d, 0.0) for d in (0.0, *(data.moved * np.array(SCOUTS)))]
    for some in (answers[::FIRST], answers):  # the noise hangs little on the answer
        models = list(dict.fromkeys(chain(*_most_likely(data, scouts, noises, some))))
        noises = list(dict.fromkeys(noise for noise, _ in models))
    if (silent := _silent(data, models, answers, longest, K, Ti)) is not None:
        return silent
    widths = np.geomspace(NARROWEST, max(TURN * data.moved, LEAST_MOTION), WIDTHS)
    # answers about the best one of many dead bands: what only fits none better, for want of trying, tells nothing
    for d, kind in product((0.0, *widths[::APART]), (False, True)):
        if (alike := [model for model in models if model[1].integrating is kind]):
            models.append(_refined(data, d, alike, K))
    rough = _fitted(data, [0.0, *widths], models, K, rounds=0).normal
    models = list(compress(models, (rough > rough.max(0) - FAR).any(1)))
    none = _fitted(data, [0.0], models, None)
    gains = _gains(none, _fitted(data, widths, models, K))
    fine = about(widths, int(gains.argmax()), FINE)
    gains = np.append(gains, _gains(none, _fitted(data, fine, models, K)))
    order = np.argsort(widths := np.append(widths, fine))
    return _confirmation(data, models, none, widths[order], gains[order], K, len(recordings))


def _blocks(recordings: Sequence[Recording], interval: float) -> _Blocks | None:
    count = sum(int(np.count_nonzero(r.usable)) for r in recordings)
    if count < FEWEST_BLOCKS:
        return None
    moved = [r.output[r.usable] for r in recordings]
    steps = sum(int(np.count_nonzero(np.abs(np.diff(u)) > NARROWEST)) for u in moved)
    size = -(-count // int(np.clip(FOR_EACH_STEP * steps, *BLOCKS)))
    mean, span = float(np.mean(np.concatenate(moved))), float(max(map(np.ptp, moved)))
    used = tuple(block_means(r.usable.astype(float), size) >= COMPLETE for r in recordings)
    level = [block_means(r.measurement - r.measurement[r.usable].mean(), size) for r in recordings]
    return _Blocks(tuple(r.output - mean for r in recordings), tuple(level), used, size, size * interval, span)


def _refined(data: _Blocks, d: float, models: Sequence[Model], K: float | None) -> Model:
    """The most likely model for a dead band, searched from the best one of some."""
    fits = _fitted(data, [d], models, K, rounds=0)
    k, start = np.unravel_index(fits.normal.argmax(), fits.normal.shape)
    stems, (noise, answer) = [data.stems(d, STARTS[start] if d else 0.0)], models[int(k)]
    unit = max(answer.lag, data.interval)

    def model(p: FloatArray) -> Model:
        lag, second, delay, ratio, fast = (float(x) for x in (np.exp(p[0]) * answer.lag, p[1], p[2], *np.exp(p[3:])))
        return (replace(noise, ratio=noise.ratio * ratio, fast=noise.fast * fast),
                Answer(lag, second * lag * (not answer.integrating), delay * unit, answer.integrating))

    def errors(p: FloatArray) -> FloatArray:
        """What a model leaves (rows,), scaled so that the likelihood is greatest where its squares are least."""
        noise, answer = model(p)
        y, X, weights = data.whitened(noise, data.columns(stems, [answer]))
        X = X[..., 0]
        return np.asarray((y - X @ np.linalg.lstsq(X, y)[0]) / np.exp(np.log(weights).mean()))

    first = np.array([0.0, answer.second / answer.lag, answer.delay / unit, 0.0, 0.0])
    ends = (np.minimum([-FARTHEST, 0.0, 0.0, -FARTHEST, -FARTHEST], first), np.maximum(FARTHEST, first))
    return model(least_squares(errors, first, bounds=ends, max_nfev=TRIALS, ftol=CLOSE).x)


def _most_likely(data: _Blocks, stems: Sequence[Sequence[FloatArray]], noises: Sequence[Noise],
                 answers: Sequence[Answer]) -> list[list[Model]]:
    """For each of the stems the KEPT models that make PV most likely, the best first."""
    columns = data.columns(stems, answers)
    whitened = (data.whitened(noise, columns) for noise in noises)
    likely = [_likelihoods(X, y, weights, rounds=0)[0].normal.reshape(len(stems), -1) for y, X, weights in whitened]
    best = np.argsort(-np.concatenate(likely, axis=1), axis=1, kind="stable")[:, :KEPT]
    return [[(noises[k // len(answers)], answers[k % len(answers)]) for k in row] for row in best.tolist()]


def _fitted(data: _Blocks, widths: Sequence[float] | FloatArray, models: Sequence[Model],
            K: float | None, rounds: int = ROUNDS) -> _Fits:
    """All models with every dead band and start: (models, widths * starts, ..). With K, only those of its sign."""
    starts = STARTS if len(widths) > 1 or widths[0] > 0.0 else (0.0,)
    stems = [data.stems(float(d), s) for d in widths for s in starts]
    whitened = (data.whitened(noise, data.columns(stems, [answer])) for noise, answer in models)
    fits = [_likelihoods(X, y, weights, rounds)[0] for y, X, weights in whitened]
    found = _Fits(*map(np.array, zip(*fits, strict=True)))
    wrong = np.where(found.coefficients[..., 0] * (K or 0.0) < 0.0, -1e9, 0.0)
    return found._replace(normal=found.normal + wrong, student=found.student + wrong)


def _likelihoods(X: FloatArray, y: FloatArray, weights: FloatArray, rounds: int = ROUNDS) -> tuple[_Fits, FloatArray]:
    """Fits of y (rows,) on each of X (rows, columns, models), and the logarithm of each row's likelihood if errors are
    Student's t (models, rows); weights: of the whitening (rows,)."""
    n, at = len(y), np.arange(X.shape[1])
    gram = np.empty((X.shape[2], len(at), len(at)))

    def solved(weighted: FloatArray) -> tuple[FloatArray, FloatArray]:
        for i, j in combinations_with_replacement(at, 2):
            gram[:, i, j] = gram[:, j, i] = np.einsum("rm,rm->m", weighted[:, i], X[:, j])
        cross = np.einsum("rcm,r->mc", weighted, y)
        ridge = gram[:, at, at] * 1e-6 + 1e-9
        gram[:, at, at] += ridge
        b = np.asarray(np.linalg.solve(gram, cross[..., None])[..., 0], dtype=np.float64)
        return b, np.sum(b * (cross + ridge * b), axis=1)

    first, explained = solved(X)
    variance = np.maximum(y @ y - explained, 1e-12 * n) / n
    normal = float(np.log(weights).sum()) - 0.5 * n * np.log(variance)
    deviation: FloatArray = np.sqrt(variance * np.linalg.inv(gram)[:, 0, 0])
    if not rounds:
        return _Fits(normal, normal, first, variance, deviation), np.empty((0, n))

    def errors(b: FloatArray) -> FloatArray:
        return y[:, None] - np.einsum("rcm,mc->rm", X, b)

    error = errors(first)
    square = np.minimum(variance, (1.4 * np.median(np.abs(error), axis=0)) ** 2 + 1e-12)
    for _ in range(rounds):
        weight = (FREEDOM + 1.0) / (FREEDOM + error**2 / square)
        error = errors(solved(X * weight[:, None])[0])
        square = np.maximum(np.mean(weight * error**2, axis=0), 1e-12)
    by_row = -0.5 * ((FREEDOM + 1.0) * np.log1p(error**2 / (FREEDOM * square)) + np.log(square)).T
    by_row += np.log(weights)
    return _Fits(normal, by_row.sum(1), first, variance, deviation), by_row


def _gains(none: _Fits, some: _Fits) -> FloatArray:
    """Evidence (widths,) of each dead band, of all models and starts: what it gains however errors are distributed."""
    of_both = [likely.reshape(len(likely), -1, len(STARTS)).max(axis=(0, 2)) - without.max()
               for likely, without in ((some.normal, none.normal), (some.student, none.student))]
    return np.asarray(np.min(of_both, axis=0), dtype=np.float64)


def _silent(data: _Blocks, models: Sequence[Model], answers: Sequence[Answer], longest: float,
            K: float | None, Ti: float | None) -> Note | None:
    """Say so where PV does not answer at all, although the process that this controller controls would have."""
    if not K or not Ti or longest < LONG_ENOUGH * Ti:
        return None
    none = _fitted(data, [0.0], models, None, rounds=0)
    k = int(none.normal[:, 0].argmax())
    if abs(none.coefficients[k, 0, 0]) > ANSWERED * none.deviation[k, 0]:
        return None
    stems = data.stems(0.0, 0.0)
    quick = [a for a in answers if not a.integrating and any(
        np.ptp(a.of(stem, data.interval)[on]) > 0.5 * data.moved for stem, on in zip(stems, data.used, strict=True))]
    y, X, weights = data.whitened(models[k][0], data.columns([stems], quick))
    fits, _ = _likelihoods(X, y, weights, rounds=0)
    if not quick or float(np.max(np.abs(fits.coefficients[:, 0]) + 2.0 * fits.deviation)) > NO_ANSWER / abs(K):
        return None
    return noted("manual_no_answer", {"at_least": data.moved / 100.0})


def _confirmation(data: _Blocks, models: Sequence[Model], none: _Fits, widths: FloatArray, gains: FloatArray,
                  K: float | None, tests: int) -> Confirmation:
    d, at = peak_of(widths, gains), int(gains.argmax())
    best = _fitted(data, [widths[at]], models, K)
    model, start = (int(i) for i in np.unravel_index(best.student.argmax(), best.student.shape))

    def by_row(d_tried: float, place: float, noise: Noise, answer: Answer) -> FloatArray:
        y, X, weights = data.whitened(noise, data.columns([data.stems(d_tried, place)], [answer]))
        return _likelihoods(X, y, weights)[1][0]

    gained = by_row(float(widths[at]), STARTS[start], *models[model]) - by_row(
        0.0, 0.0, *models[int(none.student.argmax())])
    most = float(np.bincount(data.events(TURNED * d), gained).max())
    low, high = width_interval(widths, gains, d, LEAST_INTERVAL)
    evidence, reduction = float(gains[at]), 1.0 - float(best.variance[model, start] / none.variance[model, 0])
    details: dict[str, float | str] = {"source": "manual_test", "evidence": evidence, "elsewhere": evidence - most,
        "edge": float(at in (0, len(widths) - 1)), "rows": float(len(gained)), "block_s": data.interval,
        "output_range": data.moved / 100.0, "crossings": float(data.crossings(d)), "recordings": float(tests),
        "trace": float(evidence >= TRACE), "sign_known": float(K is not None), "output": "recorded"}
    return confirmation(d, (low, high), max(reduction, 0.0), _limit(data, models, none, widths, gains), details,
                        widths, gains)


def _limit(data: _Blocks, models: Sequence[Model], none: _Fits, widths: FloatArray, gains: FloatArray) -> float | None:
    """Smallest dead band [% of span] that would have left a trace and did not, each wider one too or refuted; or None.

    What the best model without a dead band says of PV is said of a valve with one; what of it no answer without one
    explains is, over twice the variance of the errors, the evidence to expect, its deviation the root of twice that."""
    k = int(none.normal[:, 0].argmax())
    (noise, answer), b = models[k], none.coefficients[k, 0]
    answers = list(dict.fromkeys(a for _, a in models))
    y, straight, _ = data.whitened(noise, data.columns([data.stems(0.0, 0.0)], answers))
    n, even = len(y), np.ones(len(y))
    limit = None
    for d in LIMITS[data.moved > MOTION * LIMITS][::-1]:
        _, X, _ = data.whitened(noise, data.columns([data.stems(float(d), s) for s in STARTS], [answer]))
        said = np.einsum("c,rcm->mr", b, X)
        left = n * min(float(_likelihoods(straight, y, even, rounds=0)[0].variance.min()) for y in said)
        expected = 0.5 * n * np.log1p(left / (n * none.variance[k, 0]))
        seen = expected - SURE * np.sqrt(2.0 * expected) >= TRACE
        if np.interp(d, widths, gains) > -(DROP if seen else CALLED_TESTED):  # PV may answer to what it would hide
            break
        if seen and data.crossings(float(d)) >= FEWEST_CROSSINGS:  # a wider gap is crossed less, and hides more
            limit = float(d)
    return limit
