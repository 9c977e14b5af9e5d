"""What the process does: its first lag, and beyond it dead time, a second lag, a gain that drifts.

The measurement of a scan is taken before the output of the same scan acts, so x[k+1] depends on u[k] and older.

Dead time: the process answers only after the material has travelled, for example along a pipe. With theta = (n + f)
samples, any theta >= 0, the delayed, held signal changes inside the sample interval; the output sample is its mean over
the interval, (1 - f) u[k-n] + f u[k-n-1].

>>> DEAD_TIME.apply([0.0, 1.0, 1.0, 1.0, 0.0], DEAD_TIME.pack(theta=1.25), interval=1.0).tolist()
[0.0, 0.0, 0.75, 1.0, 1.0]

Second lag: a further first-order lag in series, for example a thermowell or a filter: dx/dt = (u - x) / tau2
with u held over the sample. The output sample is the mean of x over it, so that a lag behind it sees the right area.

>>> SECOND_LAG.apply([0.0, 1.0, 1.0, 1.0], SECOND_LAG.pack(tau2=2.0), interval=1.0).round(4).tolist()
[0.0, 0.2131, 0.5227, 0.7105]

Drifting gain: the same move of the valve does more and more, or less and less, as with fouling or a catalyst. The
signal's distance from `pivot` grows by `growth` per hour, counted from the first sample.

>>> GAIN_DRIFT.apply([0.5, 0.5, 0.4], GAIN_DRIFT.pack(growth=0.5, pivot=0.4), interval=3600.0).round(3).tolist()
[0.5, 0.55, 0.4]"""

import numpy as np

from ..errors import MetadataError
from ..record import FloatArray
from .fitting import Clues, Fitting, Values
from .loads import clock
from .shape import Stage, effect

MOST_SAMPLES = 10_000_000  # delayed samples are kept in memory


def ring(p: FloatArray, interval: float, first: float) -> FloatArray:
    """State: [next place in the ring, fraction f, ring of the last n + 1 inputs]."""
    samples = p[0] / interval
    if samples > MOST_SAMPLES:
        raise MetadataError(f"a dead time of {p[0]:g} s is {samples:.0f} samples", remedy="sample more coarsely")
    # a theta written as k intervals must not turn into k - 1 intervals and a fraction of 1 - 1e-16
    whole = np.floor(samples + 1e-9)
    return np.concatenate([[0.0, max(samples - whole, 0.0)], np.full(int(whole) + 1, first)])


def delay_step(state: FloatArray, value: float, p: FloatArray) -> float:
    if p[0] == 0.0:
        return value
    size = state.size - 2
    place = int(state[0])
    fraction = state[1]
    older = state[2 + place]
    state[2 + place] = value
    place = (place + 1) % size
    state[0] = place
    newer = state[2 + place]
    return newer if fraction == 0.0 else newer + fraction * (older - newer)


def late(values: FloatArray, samples: float) -> FloatArray:
    """Return a signal (samples,) delayed by any number of samples; before the first it was constant."""
    whole = int(np.floor(samples + 1e-9))
    before = np.concatenate([np.full(min(whole, len(values)) + 1, values[0]), values])[: len(values) + 1]
    return before[1:] + max(samples - whole, 0.0) * (before[:-1] - before[1:])


def delayed_lag(u: FloatArray, h: float, tau: float, delay: float) -> FloatArray:
    """Return how a first-order lag of time constant `tau` [s] follows the held samples u after `delay` [s].

    u: (samples,); h: sampling interval [s]. Exact for a zero-order hold, also when the delay is no multiple of h.
    Before the first sample u is constant. Formula: x[k+1] = a x[k] + (e-a) u[k-n-1] + (1-e) u[k-n], delay = (n+f) h,
    a = exp(-h/tau), e = exp(-(1-f) h/tau) (Astrom and Wittenmark, Computer-Controlled Systems, section 3.2)."""
    from ..kernels import lag
    whole = int(delay / h)
    a, e = float(np.exp(-h / tau)), float(np.exp(-(1.0 - (delay / h - whole)) * h / tau))
    return np.asarray(lag(u, a, e - a, 1.0 - e, whole))


def lag_transposed(z: FloatArray, h: float, tau: float) -> FloatArray:
    """Return the transposed lag of z (samples,): <lagged u, z> = <u, lag_transposed z> for u that starts at 0."""
    return delayed_lag(np.append(0.0, z[::-1]), h, tau, 0.0)[:0:-1]


def forgotten(samples: int, h: float, tau: float) -> FloatArray:
    """Return exp(-t/tau) at t = 0, h, 2 h ..., (samples,): how a lag forgets its start."""
    return np.exp(-h / tau * np.arange(samples))


DEAD_TIME = effect("dead_time", Stage.PROCESS, ring, delay_step, fitting=Fitting(
    whole=lambda values, p, interval: late(values, p[0] / interval), siblings=("second_lag",),
    propose=lambda clues: [{"theta": share * clues.lag} for share in (0.1, 0.25, 0.5, 0.8, 1.2, 2.0)]))


def lag_start(p: FloatArray, interval: float, first: float) -> FloatArray:
    """State: [x at the start of the sample, decay over one sample, mean weight of the old x]."""
    ratio = interval / p[0] if p[0] > 0.0 else np.inf
    return np.array([first, np.exp(-ratio), -np.expm1(-ratio) / ratio])


def lag_step(state: FloatArray, value: float, p: FloatArray) -> float:
    away = state[0] - value
    if p[0] == 0.0 or away == 0.0:
        state[0] = value
        return value
    state[0] = value + away * state[1]
    return value + away * state[2]


def lagged(values: FloatArray, p: FloatArray, interval: float) -> FloatArray:
    if p[0] == 0.0:
        return values
    ratio = interval / p[0]
    # its mean over each sample, from where it stands at the sample's start
    return values - np.expm1(-ratio) / ratio * (delayed_lag(values, interval, p[0], 0.0) - values)


SECOND_LAG = effect("second_lag", Stage.PROCESS, lag_start, lag_step, fitting=Fitting(whole=lagged, on_loads=True,
    siblings=("dead_time",), propose=lambda clues: [{"tau2": share * clues.lag} for share in (0.1, 0.25, 0.5, 0.9)]))


def drift_step(state: FloatArray, value: float, p: FloatArray) -> float:
    hours = state[0] * (state[1] / 3600.0)
    state[0] += 1.0
    return value if p[0] == 0.0 else value + p[0] * hours * (value - p[1])


def drifts(clues: Clues) -> list[Values]:
    """Return gains that change by a third to once over the record, about the mean of the output and about nothing."""
    hours = clues.duration / 3600.0
    places = (0.0, float(np.mean(clues.output)))
    return [{"growth": g / hours, "pivot": place} for g in (-0.6, -0.3, 0.3, 1.0) for place in places]


GAIN_DRIFT = effect("gain_drift", Stage.PROCESS, clock, drift_step, fitting=Fitting(propose=drifts, seldom=True))
