"""The shape of an oscillation: period, regularity, mean half period and how well simple shapes fit it; and its mean
cycle: does a gap in the valve explain it better than a plain linear process?

Averaged over many cycles, noise goes and the harmonics remain. They show what the fundamental hides: through a gap the
valve stands still after each reversal, and PV runs straight for that while. The process is a gain, two lags and a dead
time, all searched on a grid; with the first lag far longer than the period it is an integrator. Its gain has the sign
of the controller's: without that, PV seen through the controller's own law, which is always exact, would pass for a
process. A sticking valve looks the same as one with a gap here: with the slip jump of Kano's model as well, the cycles
of 600 simulated loops with and without a jump were explained no better.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import correlate

from ..record import FloatArray

GRID = (np.arange(64) + 0.5) / 64  # of a half period after stretching to common length
LEAST_HALF_PERIODS = 6
POINTS = 128
CYCLE = np.arange(POINTS) / POINTS
HARMONICS = np.arange(1, 10)
EVEN = HARMONICS % 2 == 0
LEAST_CYCLES = 4
MODEL_ERROR = 0.003  # of the fundamental: how well two lags and a dead time can follow a real process
DELAYS = np.linspace(0.0, 0.4, 21)  # all in periods
FIRST_LAGS = np.array([0.02, 0.05, 0.1, 0.2, 0.4, 0.8, 1.6, 50.0])
SECOND_LAGS = np.array([0.0, 0.02, 0.05, 0.1, 0.2])
GAPS = np.linspace(0.05, 0.95, 19)  # of the output's swing
EVEN_SURE = 4.0  # power of the even harmonics over their scatter
EVEN_LARGE = 0.5  # and over the fundamental: a sawtooth; noise in a valve's cycles does not make them as large


def autocorrelation(values: FloatArray, lags: int) -> FloatArray:
    """Correlation of `values` now with those 0, 1 ... lags - 1 samples later, unbiased, over their variance."""
    n, flat = len(values), values - values.mean()
    power = float(flat @ flat)
    raw = correlate(flat, flat, method="fft")[n - 1 : n - 1 + lags]
    return np.asarray(raw / power * (n / (n - np.arange(lags)))) if power > 0 else np.zeros(lags)


def detrended(values: FloatArray, period: float) -> FloatArray:
    """Values less their mean over one period around each, so that only the oscillation and faster parts stay."""
    return values - moving_mean(values, round(period))


def moving_mean(values: FloatArray, width: int) -> FloatArray:
    """Centred mean over `width` samples, over fewer at the ends."""
    width, at, total = max(width, 1), np.arange(len(values)), np.append(0.0, np.cumsum(values))
    low, high = np.maximum(at - width // 2, 0), np.minimum(at + width - width // 2, len(values))
    return np.asarray((total[high] - total[low]) / (high - low))


def find_period(values: FloatArray) -> tuple[float, float]:
    """Return the period [samples] and the height of the autocorrelation there; (0, 0) where nothing repeats.

    The first maximum after the first minimum below zero, refined by a parabola (Miao and Seborg, Control Engineering
    Practice 7 (1999) 91, use the same maxima).
    """
    r = autocorrelation(values, max(len(values) // 3, 2))
    at = [*(np.flatnonzero(np.diff(r >= 0.0)) + 1).tolist(), len(r), len(r), len(r)]  # down, up and down again
    k = at[1] + int(np.argmax(r[at[1] : at[2]])) if at[1] < at[2] else len(r)
    if k + 1 >= len(r):
        return 0.0, 0.0
    bend = r[k - 1] - 2.0 * r[k] + r[k + 1]
    return k + (0.5 * (r[k - 1] - r[k + 1]) / bend if bend < 0 else 0.0), float(r[k])


def regularity(values: FloatArray, crossings: int = 11) -> float:
    """Return mean / (3 sd) of the intervals between the first zero crossings of the autocorrelation, 0 with fewer than
    eight; above 1: regular (Thornhill, Huang and Zhang, J. Process Control 13 (2003) 91)."""
    r = autocorrelation(values, len(values) // 2)
    at = np.flatnonzero(np.sign(r[1:]) != np.sign(r[:-1]))[:crossings]
    if len(at) < 8:
        return 0.0
    length, spread = np.diff(at), np.diff(at).std(ddof=1)
    return float(length.mean() / (3.0 * spread)) if spread > 0 else np.inf


def sustained(values: FloatArray, period: float, height: float) -> float:
    """Autocorrelation five periods on (1: the same for ever, 0: forgotten); height: the same one period on."""
    far, near = round(5.0 * period), max(round(period / 8.0), 2)  # the period is not known to the sample
    if far + near >= len(values) // 2:
        return height**5
    return float(autocorrelation(values, far + near + 1)[far - near :].max())


def mean_half_period(values: FloatArray, period: float) -> FloatArray | None:
    """Return the median shape (64,) between zero crossings of a signal that oscillates with `period`, each of mean 1;
    None with fewer than six half periods."""
    flat = detrended(values, period)
    shapes = stretched(flat, crossings(flat, period)[0], (0.25 * period, 0.8 * period), GRID)
    if len(shapes) < LEAST_HALF_PERIODS:
        return None
    mean = shapes.mean(1, keepdims=True)
    return np.asarray(np.median(shapes / np.where(mean == 0.0, 1.0, mean), axis=0))


def stretched(values: FloatArray, marks: FloatArray, lengths: tuple[float, float], grid: FloatArray) -> FloatArray:
    """Values between two marks (pieces, grid), of all pieces of a length between `lengths`, at the same `grid` 0..1."""
    length = np.diff(marks)
    typical = (length > lengths[0]) & (length < lengths[1])
    time = marks[:-1][typical, None] + grid * length[typical, None]
    return np.asarray(np.interp(time, np.arange(len(values)), values))


def crossings(flat: FloatArray, period: float) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Zero crossings [samples] of a detrended signal, smoothed over a sixteenth of the period, and whether it rises."""
    smooth = moving_mean(flat, round(period / 16.0))
    sign = smooth >= 0.0
    at = np.flatnonzero(sign[1:] != sign[:-1])
    return at + smooth[at] / (smooth[at] - smooth[at + 1]), sign[at + 1]


def misfits(shape: FloatArray) -> list[float]:
    """Sums of squares that the best half sine, the best constant and the best triangle, whose peak may be anywhere (He
    et al. 2007), leave of a half period (64,)."""
    peaks, left = np.linspace(0.1, 0.9, 33)[:, None], []
    for bases in (np.sin(np.pi * GRID)[None], np.ones((1, len(GRID))),
                  np.minimum(GRID / peaks, (1.0 - GRID) / (1.0 - peaks))):
        along = (bases @ shape) / np.sum(bases * bases, axis=1)
        left.append(float(np.sum((shape - bases * along[:, None]) ** 2, axis=1).min()))
    return left


@dataclass(frozen=True)
class CycleTest:
    """misfit: mean squared error of the harmonics of PV without a gap, in units of their scatter (1: explained).

    left: share of it that remains with the best gap. d: that gap [span of output]. first_lag: lag [periods] of the
    process that fits then. harmonics: all above the first, over the first.
    integral_phase: lag of OP behind proportional action [degrees]; 90 is integral action alone.
    symmetric: the second half of a cycle repeats the first upside down, as it does behind a gap or a sticking valve.
    """

    misfit: float
    left: float
    d: float
    first_lag: float
    harmonics: float
    symmetric: bool
    integral_phase: float

    @property
    def evidence(self) -> float:
        """Likelihood ratio 2 ln L in favour of the gap, for normal errors of nine complex harmonics."""
        return 2.0 * len(HARMONICS) * self.misfit * (1.0 - self.left)

    @property
    def unexplained(self) -> float:
        """What remains with the best gap, in units of the scatter (1: explained)."""
        return self.misfit * self.left


def compare_mean_cycle(measurement: FloatArray, output: FloatArray, period: float,
                       action: float = 0.0) -> CycleTest | None:
    """Compare the mean cycle of PV with that of OP through a linear process, with and without a gap in the valve.

    action: sign of the controller gain K, 0 where it is not known and is read from the phase. With PI control OP leads
    PV by 90 to 180 degrees for a positive K and lags it by up to 90 degrees for a negative one."""
    from ..kernels import play

    pv, op = detrended(measurement, period), detrended(output, period)
    at, rising = crossings(pv, period)
    pv_cycles, op_cycles = (stretched(x, at[rising], (0.6 * period, 1.5 * period), CYCLE) for x in (pv, op))
    if len(pv_cycles) < LEAST_CYCLES:
        return None
    parts, n = np.fft.rfft(pv_cycles, axis=1)[:, HARMONICS] / POINTS, len(pv_cycles)
    target = parts.mean(0)
    scatter = np.sum(np.abs(parts - target) ** 2, axis=0) / (n * (n - 1))
    weight = 1.0 / (scatter + (MODEL_ERROR * np.abs(target[0])) ** 2)
    mean_output = op_cycles.mean(0)
    # by how much OP leads PV; of an unknown sign the middle of the quadrant decides
    lead = target[0].conj() * np.fft.rfft(mean_output)[1]
    sign = np.sign(action) or (1.0 if np.cos(np.angle(lead) - 0.75 * np.pi) > 0 else -1.0)
    gaps = np.concatenate([[0.0], GAPS]) * np.ptp(mean_output)
    twice = np.tile(mean_output, 2)  # behind a gap it has settled after one cycle
    through = np.array([np.fft.rfft(play(twice, d, twice[0])[POINTS:])[HARMONICS] / POINTS for d in gaps])
    left, first_lags = _best_processes(target, np.asarray(sign * through, dtype=np.complex128), weight)
    misfit = left / len(HARMONICS)
    best = int(misfit.argmin())
    share = float(misfit[best] / misfit[0]) if misfit[0] > 0 else 1.0
    size = np.abs(target) / max(float(np.abs(target[0])), 1e-300)
    even = float(np.mean((np.abs(target) ** 2 / np.maximum(scatter, 1e-300))[EVEN]))
    lopsided = even > EVEN_SURE and float(np.sqrt(np.sum(size[EVEN] ** 2))) > EVEN_LARGE
    return CycleTest(float(misfit[0]), share, float(gaps[best]), float(first_lags[best]),
                     float(np.sqrt(np.sum(size[1:] ** 2))), not lopsided, float(-np.degrees(np.angle(-sign * lead))))


def _best_processes(target: NDArray[np.complex128], through: NDArray[np.complex128],
                    weight: FloatArray) -> tuple[FloatArray, FloatArray]:
    """For each gap the weighted squares that the best process leaves, and its first lag [periods]; through: (gaps,
    harmonics) of the output behind each gap. Dead time and lags from a grid, then twice finer."""
    gaps = len(through)
    delays, first, second = (np.tile(grid, (gaps, 1)) for grid in (DELAYS, FIRST_LAGS, SECOND_LAGS))
    w, every = 2j * np.pi * HARMONICS, np.arange(gaps)
    for finer in (0.5, 0.2, 0.0):
        lags = (1.0 / (1.0 + w * first[:, :, None]))[:, :, None] / (1.0 + w * second[:, None, :, None])
        lags = lags.reshape(gaps, -1, len(HARMONICS))
        delayed = np.conj(through[:, None, :] * np.exp(-w * delays[:, :, None])) * (target * weight)
        # a gain of the wrong sign is no process
        along = np.maximum((delayed @ np.conj(lags).transpose(0, 2, 1)).real, 0.0)
        own = (np.abs(lags) ** 2 @ (np.abs(through) ** 2 * weight)[:, :, None])[..., 0]
        left = np.sum(np.abs(target) ** 2 * weight) - along**2 / np.maximum(own, 1e-300)[:, None, :]
        at = left.reshape(gaps, -1).argmin(1)
        smallest = left.reshape(gaps, -1)[every, at]
        i, j, k = np.unravel_index(at, (delays.shape[1], first.shape[1], second.shape[1]))
        delay, one, two = delays[every, i, None], first[every, j, None], second[every, k, None]
        near = np.linspace(-finer, finer, 7)
        delays = np.clip(delay + 0.02 * near, 0.0, None)
        first, second = one * 2.0**near, np.clip(two * 2.0**near, 0.005 * finer, None)
    return smallest, one[:, 0]
