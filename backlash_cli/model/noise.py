"""What the model does not explain, as a random load behind two lags plus white measurement noise.

w[k+1] = a1 w[k] + v[k],  l[k+1] = a2 l[k] + (1 - a2) w[k],  error[k] = l[k] + e[k],  a = exp(-h/T).
The Kalman filter of this model whitens the error exactly, with missing samples, so that a likelihood of the
prediction error holds in closed loop too (Ljung, System Identification, chapter 4; Harvey 1989, chapter 3)."""

from collections.abc import Callable

import numpy as np

from .. import kernels
from ..record import BoolArray, FloatArray, Frozen

SLOWEST = 0.1  # what wanders more slowly than this share of the record is no noise about a mean: it is a drift
CLOSE_ENOUGH = 0.02  # deviances closer than this tell nothing about the noise
# a search starts at least this share of its range from its ends; its steps, at most, and for slopes, in logarithms
NEAR_END, MOST_MOVE, SMALL, ROUNDS, DAMPING = 0.1, 2.0, 1e-2, 20, 0.1
LESS, MORE, TRIES = 0.2, 8.0, 4  # damping after a step that was better, or not; steps tried from one place
Local = tuple[FloatArray, FloatArray]


class Noise(Frozen):
    """Random load with standard deviation `ratio` times that of the white noise, and its two time constants [s]."""

    ratio: float
    slow: float
    fast: float

    def at_rest(self, h: float) -> tuple[float, float, float, float, float]:
        """Return both decays over an interval h [s], and the covariance (p11, p12, p22) of (w, l) at rest."""
        a1, a2 = np.exp([-h / self.slow, -h / self.fast]).tolist()
        b = 1.0 - a2
        p12 = a1 * b / (1.0 - a1 * a2)
        p22 = (2.0 * a2 * b * p12 + b * b) / (1.0 - a2 * a2)
        scale = self.ratio**2 / p22
        return a1, a2, scale, p12 * scale, p22 * scale


class Whitener(Frozen):
    """Kalman gains of one Noise on one record: gain (samples, 2), weight (samples,) = 1/sqrt(innovation variance), 0
    where a sample does not count. log_det: sum of the logarithms of the innovation variances."""

    a1: float
    a2: float
    gain: FloatArray
    weight: FloatArray
    log_det: float
    samples: int

    def columns(self, X: FloatArray) -> FloatArray:
        """Return the whitened columns of X (samples, columns), or the one of X (samples,)."""
        columns = np.ascontiguousarray(X.reshape(len(X), -1))
        return np.asarray(kernels.whiten(columns, self.a1, self.a2, self.gain, self.weight)).reshape(X.shape)

    def transposed(self, z: FloatArray) -> FloatArray:
        """Return the transposed whitening of z (samples,): <whitened x, z> = <x, transposed z> for every x."""
        return np.asarray(kernels.whiten_transposed(z, self.a1, self.a2, self.gain, self.weight))

    def deviance(self, rss: float) -> float:
        """Return -2 log likelihood with the noise variance profiled out, from the whitened sum of squares."""
        return self.samples * float(np.log(max(rss, 1e-300) / self.samples)) + self.log_det


def whitener(noise: Noise, used: BoolArray, h: float) -> Whitener:
    """Return the whitening filter of `noise` for the samples `used` at interval h [s]."""
    n, rest = len(used), noise.at_rest(h)
    gain, weight = np.zeros((n, 2)), np.zeros(n)
    _, log_det = kernels.kalman(np.zeros(n), used, *rest, gain, weight)
    return Whitener(rest[0], rest[1], gain, weight, float(log_det), int(np.count_nonzero(used)))


def downhill(x: FloatArray, squares: Callable[[FloatArray], float], local: Callable[[FloatArray], Local],
             low: FloatArray, high: FloatArray, samples: int, rounds: int, tolerance: float, damping: float = 1e-2,
             most: float = np.inf) -> FloatArray:
    """Return numbers (numbers,) of fewer squares, by a few steps, until the deviance gains less than `tolerance`.

    squares: sum over `samples` errors; the deviance is samples times its logarithm. local: half the Hessian (numbers,
    numbers) and gradient (numbers,) of the squares. low, high: (numbers,) bounds. most: the longest step.
    Source: Levenberg (1944), Marquardt (1963), damping scaled by the diagonal."""
    least = squares(x)
    for _ in range(rounds):
        A, g = local(x)
        if not np.isfinite(A).all() or not np.isfinite(g).all():  # at the edge of what can be computed
            break
        diagonal = np.maximum(np.diag(A), 1e-12 * max(float(np.max(np.diag(A))), 1e-300))
        gained = 0.0
        for _try in range(TRIES):
            move = np.asarray(-np.linalg.solve(A + np.diag(damping * diagonal), g), dtype=np.float64)
            trial = np.clip(x + np.clip(move, -most, most), low, high)
            found = squares(trial)
            if found < least:
                gained = samples * float(np.log(least / found))
                x, least, damping = trial, found, max(damping * LESS, 1e-6)
                break
            damping = min(damping * MORE, 1e6)
        if gained < tolerance:
            break
    return x


def fit_noise(error: FloatArray, used: BoolArray, h: float, first: Noise) -> Noise:
    """Return the noise of greatest likelihood for an error (samples,), 0 where not `used`, searched from `first`.

    With the noise variance profiled out the likelihood is greatest where the sum of squares of the innovations, each
    times (product of their variances)^(1 / 2n), is smallest."""
    longest = SLOWEST * h * len(error)
    low, high = np.log([[1e-3, 1e3], [0.5 * h, longest], [0.1 * h, longest]]).T
    count, none = int(np.count_nonzero(used)), (np.empty((0, 2)), np.empty(0))

    def innovations(x: FloatArray) -> FloatArray:
        white, log_det = kernels.kalman(error, used, *Noise(*np.exp(x).tolist()).at_rest(h), *none)
        return np.asarray(white * np.exp(0.5 * log_det / count))

    def local(x: FloatArray) -> Local:
        here = innovations(x)
        J = np.column_stack([(innovations(x + move) - here) / SMALL for move in SMALL * np.eye(3)])
        return J.T @ J, J.T @ here

    inside = NEAR_END * (high - low)
    x = np.clip(np.log([first.ratio, first.slow, first.fast]), low + inside, high - inside)
    ratio, *times = np.exp(downhill(x, lambda x: float(np.sum(innovations(x) ** 2)), local, low, high, count, ROUNDS,
                                    CLOSE_ENOUGH, DAMPING, MOST_MOVE)).tolist()
    return Noise(ratio, max(times), min(times))


def known_load(error: FloatArray, used: BoolArray, h: float, noise: Noise, ahead: int) -> FloatArray:
    """Return the load in PV (samples,) as known `ahead` samples before, from what a model missed until then; error:
    (samples,) measured minus predicted PV, any number where not `used`. Harvey (1989), section 3.5."""
    white = whitener(noise, used, h)
    a1, a2, b = white.a1, white.a2, 1.0 - white.a2
    innovation = white.columns(np.where(used, error, 0.0)) / np.where(used, white.weight, 1.0)
    to_w, to_l = (white.gain * innovation[:, None]).T
    # both start from nothing, which is what a lag at rest at the 0 put before comes to
    w = kernels.lag(np.append(0.0, to_w), a1, 0.0, a1, 0)[1:]
    lagged = kernels.lag(np.append(0.0, a2 * to_l + b * (w + to_w)), a2, 0.0, 1.0, 0)[1:]
    # so many samples later the lagged load is l a2^more + w b (a1^(more-1) + a1^(more-2) a2 + ... + a2^(more-1))
    more, powers = ahead - 1, np.arange(ahead - 1)
    later = a2**more * lagged + b * float(np.sum(a1**powers * a2 ** powers[::-1])) * w
    return np.append(np.zeros(more), later)[: len(error)]
