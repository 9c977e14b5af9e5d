"""Loads and noise: what something other than the valve does to the process, or to what is measured.

Load steps: sudden changes at the process input that the controller must make up for. Each size is in output span: a
load step of 0.05 pushes the process like 5 % more output. A step counts from the first sample at or after its time.

>>> p = LOAD_STEP.pack(times=[2.0, 3.0], sizes=[0.5, -0.25])
>>> LOAD_STEP.apply([0.0, 0.0, 0.0, 0.0, 0.0], p, interval=1.0).tolist()
[0.0, 0.0, 0.5, 0.25, 0.25]

Load drift: something slow, such as fouling or weather, pushes the process further and further.

>>> LOAD_DRIFT.apply([0.0, 0.0, 0.0], LOAD_DRIFT.pack(slope=0.36), interval=100.0).round(3).tolist()
[0.0, 0.01, 0.02]

A drift need not be straight: `bends` are what it lies off the straight line at equally spaced times within `length`.

>>> p = LOAD_DRIFT.pack(slope=0.36, length=400.0, bends=[0.1])
>>> LOAD_DRIFT.apply([0.0, 0.0, 0.0, 0.0, 0.0], p, interval=100.0).round(3).tolist()
[0.0, 0.06, 0.12, 0.08, 0.04]

External oscillation: another loop or machine swings and shakes this process with it.

>>> p = EXTERNAL_OSCILLATION.pack(period=4.0, amplitude=0.1)
>>> EXTERNAL_OSCILLATION.apply([0.5, 0.5, 0.5, 0.5], p, interval=1.0).round(3).tolist()
[0.5, 0.6, 0.5, 0.4]

Measured disturbance: a further recorded signal pushes the process. The column's samples follow the state, in its own
units; `gain` turns them into output span.

>>> p = MEASURED_DISTURBANCE.pack(gain=0.01)
>>> MEASURED_DISTURBANCE.apply([0.5, 0.5, 0.5], p, interval=1.0, series=[0.0, 10.0, -10.0]).tolist()
[0.5, 0.6, 0.4]

Random signals with a limited bandwidth, exact for any sample interval:
dx = -b x dt + b sqrt(S) dW has corner frequency b [rad/s], variance S b / 2 and two-sided density S [span^2 s] at low
frequency. A sample is the mean of x over its interval, so what a slower process sees does not depend on the interval;
b = inf is white noise, whose mean over h has variance S / h. Given x at the start of an interval, its mean and its
end value are jointly normal with closed-form moments (Gillespie, Phys. Rev. E 54 (1996) 2084).

Measurement noise: the transmitter's random error, given by density and bandwidth. A standard deviation alone says
nothing: white noise of standard deviation s held over h seconds has density s^2 h, which is what a filter feels.

>>> p = MEASUREMENT_NOISE.pack(density=4e-8)
>>> MEASUREMENT_NOISE.apply([0.5, 0.5], p, interval=0.01, series=[0.0, 0.0, 0.0, 1.0, 0.0, -1.0]).round(4).tolist()
[0.502, 0.498]

Random load: the process input wanders about its mean, as flows, pressures and compositions upstream do.

>>> p = RANDOM_LOAD.pack(sd=0.01, time_constant=50.0)
>>> numbers = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]
>>> RANDOM_LOAD.apply([0.5, 0.5], p, interval=5.0, series=numbers).round(4).tolist()
[0.5095, 0.5086]"""

import math
from collections.abc import Callable

import numpy as np

from ..record import FloatArray
from .fitting import Fitting, Values
from .shape import Stage, effect

UNANSWERED = 1.5  # travels of OP around it that a step may be larger: a slow loop may not be through yet


def clock(p: FloatArray, interval: float, first: float) -> FloatArray:
    """State: [sample number, interval]."""
    return np.array([0.0, interval])


def step_step(state: FloatArray, value: float, p: FloatArray) -> float:
    # half a nanosecond of slack: 0.3 s is the third sample of 0.1 s, whatever the floating point
    now = state[0] * state[1] + 5e-10
    state[0] += 1.0
    count = p.size // 2
    for i in range(count):
        if now >= p[i]:
            value += p[count + i]
    return value


def step_plausible(values: Values, travel: Callable[[float], float]) -> bool:
    """True when OP answered each step: the controller makes up for a load by as much output, wherever it is free to."""
    pairs = zip(np.atleast_1d(values["times"]), np.atleast_1d(values["sizes"]), strict=True)
    return all(abs(size) <= UNANSWERED * travel(float(time)) for time, size in pairs)


LOAD_STEP = effect("load_step", Stage.LOAD, clock, step_step, fitting=Fitting(
    linear=("sizes",), fixed=("times",), dear=("times",), plausible=step_plausible,
    propose=lambda clues: [{"times": t, "sizes": (0.0,) * len(t)} for t in clues.step_times(5)]))


def drift_step(state: FloatArray, value: float, p: FloatArray) -> float:
    hours = state[0] * (state[1] / 3600.0)
    place = state[0] * ((p.size - 1) * state[1] / p[1]) if p[1] > 0.0 else 0.0
    state[0] += 1.0
    if p[0] != 0.0:
        value += p[0] * hours
    piece, bends = int(place), p.size - 2
    share = place - piece
    if 0 < piece <= bends:  # bend number piece lies at the start of this piece; both ends of the line are 0
        value += (1.0 - share) * p[1 + piece]
    if piece < bends:
        value += share * p[2 + piece]
    return value


def drift_plausible(values: Values, travel: Callable[[float], float]) -> bool:
    """True when the load goes mostly one way: what wanders to and fro is a random load, not a drift."""
    length, slope, bends = values["length"], values["slope"], values["bends"]
    assert isinstance(length, float) and isinstance(slope, float) and isinstance(bends, tuple)
    net = slope * length / 3600.0
    path = np.linspace(0.0, net, len(bends) + 2) + np.array([0.0, *bends, 0.0])
    return abs(net) >= 0.5 * float(np.sum(np.abs(np.diff(path))))


LOAD_DRIFT = effect("load_drift", Stage.LOAD, clock, drift_step, fitting=Fitting(
    linear=("slope", "bends"), fixed=("length",), plausible=drift_plausible,
    propose=lambda clues: [{"slope": 0.0, "length": clues.duration, "bends": (0.0,) * n} for n in (0, 1, 3, 5, 8)]))


def swing_step(state: FloatArray, value: float, p: FloatArray) -> float:
    now = state[0] * state[1]
    state[0] += 1.0
    return value if p[1] == 0.0 else value + p[1] * math.sin(2.0 * math.pi * now / p[0] + p[2])


EXTERNAL_OSCILLATION = effect("external_oscillation", Stage.LOAD, clock, swing_step, fitting=Fitting(
    linear=("amplitude",), phase="phase", dear=("period",),
    propose=lambda clues: [{"period": t, "amplitude": 0.0, "phase": 0.0} for t in clues.periods(3)]))


def column_step(state: FloatArray, value: float, p: FloatArray) -> float:
    state[0] += 1.0
    return value if p[0] == 0.0 else value + p[0] * state[int(state[0])]


MEASURED_DISTURBANCE = effect("measured_disturbance", Stage.LOAD, lambda p, interval, first: np.zeros(1), column_step,
    column=True, fitting=Fitting(linear=("gain",)))


def coloured_start(density: float, bandwidth: float, interval: float) -> FloatArray:
    """State: [place in the numbers, x, decay of x, weight of x in the mean, L11, L21, L22], then normal numbers.

    x is in standard deviations until the first sample. L is the Cholesky factor of (end value, mean) given x."""
    if np.isinf(bandwidth):
        return np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, np.sqrt(density / interval)])
    n, variance = bandwidth * interval, 0.5 * density * bandwidth
    decay = np.exp(-n)
    # the closed form cancels to nothing for short intervals; the first term of its series is exact enough there
    shape = n**3 / 3.0 if n < 1e-3 else n - 2.0 * (1.0 - decay) + 0.5 * (1.0 - decay * decay)
    end_sd = np.sqrt(variance * -np.expm1(-2.0 * n))
    shared = variance * np.expm1(-n) ** 2 / (n * end_sd) if end_sd > 0.0 else 0.0
    rest = np.sqrt(max(2.0 * variance * shape / n**2 - shared**2, 0.0))
    return np.array([0.0, np.sqrt(variance), decay, -np.expm1(-n) / n, end_sd, shared, rest])


def coloured_step(state: FloatArray, value: float, p: FloatArray) -> float:
    if p[0] == 0.0:
        return value
    place = 7 + int(state[0])
    if place == 7:
        state[1] *= state[place]
        place += 2
    x, first, second = state[1], state[place], state[place + 1]
    state[0] = place - 5
    state[1] = state[2] * x + state[4] * first
    return value + state[3] * x + state[5] * first + state[6] * second


MEASUREMENT_NOISE = effect("measurement_noise", Stage.SENSOR, lambda p, interval, first: coloured_start(
    p[0], p[1], interval), coloured_step, draws=2, fitted=False)

RANDOM_LOAD = effect("random_load", Stage.LOAD, lambda p, interval, first: coloured_start(
    2.0 * p[0] ** 2 * p[1], 1.0 / p[1], interval), coloured_step, draws=2, fitted=False)
