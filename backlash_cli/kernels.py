"""Loops over samples that NumPy cannot vectorise, compiled by numba on first use (imported lazily, cached on disk)."""

import warnings
from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numba
import numpy as np
from numba.core.errors import NumbaExperimentalFeatureWarning
from numpy.typing import NDArray


def compiled(function: Callable[..., Any], signature: Any = None) -> Any:
    """Compile a loop, kept on disk where there is a place for it; a service without a home has none."""
    try:
        return numba.njit(signature, cache=True)(function)
    except RuntimeError:
        return numba.njit(signature)(function)


@compiled
def play(u: NDArray[Any], d: float, start: float) -> NDArray[Any]:
    """Valve position behind a dead band d, started at position `start`: stays while u moves inside the band.

    u: (samples,) controller output; returns (samples,). At d = 0 the output is u bit for bit.
    Source: Haegglund (2007), Fig. 2; the play operator of Krasnosel'skii and Pokrovskii (1989)."""
    out = np.empty_like(u)
    x, half = start, 0.5 * d
    for k in range(len(u)):
        x = min(max(x, u[k] - half), u[k] + half) if d != 0.0 else u[k]
        out[k] = x
    return out


@compiled
def gap_means(u: NDArray[Any], widths: NDArray[Any], size: int, count: int) -> NDArray[Any]:
    """Means over `count` blocks of `size` samples of what the stem lags behind OP, for each dead band in `widths`.

    u: (samples,) controller output; widths: (widths,) dead bands in its units; returns (widths, blocks) of
    play(u) - u. Until u has covered a whole gap, the stem is taken to stand in the middle of where it may stand."""
    out = np.zeros((count, len(widths)))  # the widths of a block side by side: they are computed together
    half, x = 0.5 * widths, np.empty(len(widths))
    low = high = u[0]
    for i in range(count * size):
        v, sums = u[i], out[i // size]
        low, high = min(low, v), max(high, v)
        for j in range(len(widths)):
            x[j] = 0.5 * (low + high) if high - low < widths[j] else x[j]
            x[j] = min(max(x[j], v - half[j]), v + half[j])
            sums[j] += x[j] - v
    return np.ascontiguousarray(out.T) / size


@compiled
def forgetting_gap_means(u: NDArray[Any], widths: NDArray[Any], rates: NDArray[Any], size: int,
                         count: int) -> NDArray[Any]:
    """The same for gaps that forget: -clip(u - slow mean of u, half a width), (rates, widths, blocks).

    rates: of the mean per sample. Like a dead band in shape, but it depends on how fast OP moves, which no gap does:
    what explains PV as well as this one does is no valve."""
    out = np.zeros((len(rates), len(widths), count))
    half = 0.5 * widths
    for k in range(len(rates)):
        mean = u[0]
        for i in range(count * size):
            mean += rates[k] * (u[i] - mean)
            away = u[i] - mean
            for j in range(len(widths)):
                out[k, j, i // size] -= min(max(away, -half[j]), half[j])
    return out / size


@compiled
def lagged_means(signals: NDArray[Any], rows: NDArray[np.int64], fine: int, far: int) -> NDArray[Any]:
    """Lags of signals (signals, blocks) before each of the rows: `fine` single blocks, then `far` means over 2, 4, 8 ..
    blocks; returns (signals, fine + far, rows)."""
    out = np.empty((len(signals), fine + far, len(rows)))
    for s in range(len(signals)):
        for j in range(len(rows)):
            at = rows[j] - 1
            for i in range(fine):
                out[s, i, j] = signals[s, at - i]
            at -= fine
            for i in range(far):
                total = 0.0
                for _ in range(2 << i):
                    total += signals[s, at]
                    at -= 1
                out[s, fine + i, j] = total / (2 << i)
    return out


@compiled
def gap_crossings(u: NDArray[Any], width: float) -> int:
    """How often the stem behind a dead band of `width` began to move the other way: OP crossed the whole gap."""
    half, x, way, crossings = 0.5 * width, u[0], 0, 0
    for i in range(len(u)):
        to = min(max(x, u[i] - half), u[i] + half)
        if to != x:
            now = 1 if to > x else -1
            crossings += 1 if way == -now else 0
            x, way = to, now
    return crossings


# --- for the workbench and the simulator -----------------------------------------------------------------------------

FLOATS = numba.types.Array(numba.types.float64, 1, "C")
STEP_SIGNATURE = numba.types.float64(FLOATS, numba.types.float64, FLOATS)
STEP_POINTER = numba.types.FunctionType(STEP_SIGNATURE)
MATRIX = numba.types.Array(numba.types.float64, 2, "C")
INTEGERS = numba.types.Array(numba.types.int64, 1, "C")
FLAGS = numba.types.Array(numba.types.boolean, 1, "C")
# most effects in one loop, and the sizes of the states of its controller
SLOTS, PID_STATE, COMPENSATOR_STATE = 16, 7, 4


def with_pointers(*arguments: Any, returns: Any = numba.types.void) -> Callable[[Callable[..., Any]], Any]:
    """Compile a function that calls steps of effects by pointer at its first call: once, whatever the effects are."""

    def later(function: Callable[..., Any]) -> Any:
        @lru_cache(maxsize=1)
        def machine() -> Any:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", NumbaExperimentalFeatureWarning)
                return compiled(function, returns(*arguments))

        def call(*values: Any) -> Any:
            return machine()(*values)

        call.py_func = function  # type: ignore[attr-defined]
        return call

    return later


@with_pointers(STEP_POINTER, FLOATS, FLOATS, FLOATS, FLOATS)
def run_steps(step: Any, state: Any, values: Any, p: Any, out: Any) -> None:
    """Send values (samples,) one by one through the step of an effect, whose state changes in place."""
    for k in range(values.size):
        out[k] = step(state, values[k], p)


@compiled
def lag(u: NDArray[Any], keep: float, older: float, newer: float, late: int) -> NDArray[Any]:
    """First-order lag x[k+1] = keep x[k] + older u[k-late-1] + newer u[k-late], (samples,), at rest at u[0] before."""
    out = np.empty_like(u)
    x, first = u[0], min(late + 1, len(u))
    for k in range(first):
        out[k] = x
        x = keep * x + older * u[0] + newer * u[max(k - late, 0)]
    for k in range(first, len(u)):
        out[k] = x
        x = keep * x + (older * u[k - late - 1] + newer * u[k - late])
    return out


@compiled
def kalman(error: NDArray[Any], used: NDArray[Any], a1: float, a2: float, p11: float, p12: float, p22: float,
           gain: NDArray[Any], weight: NDArray[Any]) -> tuple[NDArray[Any], float]:
    """Run the Kalman filter of a load behind two lags over an error; return its innovations and their log determinant.

    error, used: (samples,). a1, a2: decay per sample. p11, p12, p22: covariance at rest, in variances of the white
    noise. The innovations (samples,) are over their deviation, 0 where not `used`. gain (samples, 2) and weight
    (samples,), one over that deviation, are written where they have that length."""
    out = np.zeros(len(error))
    b, q = 1.0 - a2, p11 * (1.0 - a1 * a1)
    log_det = log_s = w = lagged = g1 = g2 = scale = 0.0
    steady, keep = False, len(weight) == len(error)
    for k in range(len(error)):
        settled = steady and used[k]
        if used[k]:
            if not settled:
                s = p22 + 1.0
                new1, new2 = p12 / s, p22 / s
                steady = abs(new1 - g1) < 1e-11 * (1.0 + abs(g1)) and abs(new2 - g2) < 1e-11
                g1, g2, log_s, scale = new1, new2, np.log(s), 1.0 / np.sqrt(s)
                p11, p12, p22 = p11 - g1 * p12, p12 - g1 * p22, p22 - g2 * p22
            out[k] = (error[k] - lagged) * scale
            log_det += log_s
            if keep:
                gain[k, 0], gain[k, 1], weight[k] = g1, g2, scale
        else:
            steady, g1, g2 = False, 0.0, 0.0
        if not settled:
            p22 = a2 * a2 * p22 + 2.0 * a2 * b * p12 + b * b * p11
            p11, p12 = a1 * a1 * p11 + q, a1 * (a2 * p12 + b * p11)
        # the two lags one sample later, gains put in: the shortest way from one sample to the next
        to_w, to_l, x = a1 * g1, a2 * g2 + b * g1, error[k]
        w, lagged = (a1 * w + to_w * x) - to_w * lagged, (a2 - to_l) * lagged + (b * w + to_l * x)
    return out, log_det


@compiled
def whiten(X: NDArray[Any], a1: float, a2: float, gain: NDArray[Any], weight: NDArray[Any]) -> NDArray[Any]:
    """Whitened columns of X (samples, columns): the innovations of each under gains of `kalman`, times `weight`."""
    samples, columns = X.shape
    out = np.empty((samples, columns))
    w, lagged, one, two = np.zeros(columns), np.zeros(columns), 0.0, 0.0
    b = 1.0 - a2
    for k in range(samples):
        to_w, to_l, scale = a1 * gain[k, 0], a2 * gain[k, 1] + b * gain[k, 0], weight[k]
        if columns == 1:  # what stays in registers takes half the time
            x = X[k, 0]
            out[k, 0] = (x - two) * scale
            one, two = (a1 * one + to_w * x) - to_w * two, (a2 - to_l) * two + (b * one + to_l * x)
            continue
        for j in range(columns):
            x, one, two = X[k, j], w[j], lagged[j]
            out[k, j] = (x - two) * scale
            lagged[j] = (a2 - to_l) * two + (b * one + to_l * x)
            w[j] = (a1 * one + to_w * x) - to_w * two
    return out


@compiled
def whiten_transposed(z: NDArray[Any], a1: float, a2: float, gain: NDArray[Any], weight: NDArray[Any]) -> NDArray[Any]:
    """The transposed whitening of z (samples,): <whitened x, z> = <x, result> for every x."""
    out = np.empty_like(z)
    to_w = to_l = 0.0  # how the sum changes with the two lags of the next sample
    for k in range(len(z) - 1, -1, -1):
        w, lagged = a1 * to_w + (1.0 - a2) * to_l, a2 * to_l
        out[k] = weight[k] * z[k] + gain[k, 0] * w + gain[k, 1] * lagged
        to_w, to_l = w, lagged - out[k]
    return out


@compiled
def pid(state: Any, p: Any, setpoint: float, measurement: float, feedforward: float, by_hand: bool, hand: float
        ) -> float:
    """One controller sample: returns the feedback part; state: [x1, yf, s1, sf, integral, error, output].

    The new sample counts as the mean over the interval before it. Away from automatic the integral part follows,
    so that the return is without a bump; `hand` nan holds the output."""
    gain, integral, derivative, b, c, low, high, windup, a, w = (
        p[0], p[1], p[2], p[3], p[4], p[5], p[6], p[7], p[8], p[9])
    x, s = state[0] - measurement, state[2] - setpoint
    state[1] = measurement + a * (state[1] - measurement) + w * x
    state[0] = measurement + a * x
    state[3] = setpoint + a * (state[3] - setpoint) + w * s
    state[2] = setpoint + a * s
    filtered = state[1]
    error = setpoint - filtered
    state[5] = error
    rest = gain * (b * setpoint - filtered) + derivative * (c * (state[2] - state[3]) - (state[0] - filtered))
    if by_hand:
        if not np.isnan(hand):
            state[6] = hand
        state[4] = state[6] - rest - feedforward
        return state[6] - feedforward
    state[4] += integral * error
    free = rest + state[4]
    limited = min(max(free + feedforward, low), high)
    state[4] += windup * (limited - free - feedforward)
    state[6] = limited
    return free


@compiled
def compensation(state: Any, p: Any, feedback: float, error: float) -> float:
    """Feedforward (7), (8) or (9) for one controller sample; state: [x1, xf, last, sign]."""
    scheme, half, hysteresis, a, w = p[0], p[1], p[2], p[3], p[4]
    if scheme == 0.0:
        return 0.0
    value = error if scheme == 9.0 else feedback
    x = state[0] - value
    state[1] = value + a * (state[1] - value) + w * x
    state[0] = value + a * x
    signal = state[1] if scheme == 9.0 else state[1] - state[2]
    state[2] = state[1]
    # at exactly zero the sign stays: the valve rests and so does the compensation
    if abs(signal) > hysteresis:
        state[3] = np.sign(signal)
    return half * state[3]


@with_pointers(
    numba.types.UniTuple(STEP_POINTER, SLOTS), INTEGERS, INTEGERS, INTEGERS, FLOATS, FLOATS,
    MATRIX, FLOATS, FLOATS, FLOATS, FLOATS, FLOATS, FLOATS, FLOATS, FLOATS, numba.types.int64,
    FLOATS, FLAGS, FLOATS, numba.types.float64, numba.types.float64, numba.types.float64, MATRIX,
    returns=numba.types.int64)
def closed_loop(steps: Any, state_at: Any, p_at: Any, ends: Any, states: Any, p: Any, decay: Any, newer: Any,
                older: Any, readout: Any, line: Any, pid_p: Any, pid_state: Any, comp_p: Any, comp_state: Any,
                every: int, setpoint: Any, by_hand: Any, hand: Any, level: float, rest: float, limit: float, out: Any
                ) -> int:
    """Run the loop; fills out (5, samples): measurement, output, valve position, process output, filtered error.

    ends: [n valve and process effects, n with load effects, n with sensor effects] into the effects' tables.
    line: delay line of process inputs. level, rest: process output and input at rest. Returns the sample at
    which the process output left level +- limit, or the number of samples."""
    order, size = readout.size, line.size
    x, new = np.zeros(order), np.zeros(order)
    output, place = pid_state[6], 0
    for k in range(setpoint.size):
        y = level
        for i in range(order):
            y += readout[i] * x[i]
        if not abs(y - level) < limit:
            return k
        measured = y
        for i in range(ends[1], ends[2]):
            measured = steps[i](states[state_at[i] : state_at[i + 1]], measured, p[p_at[i] : p_at[i + 1]])
        if k % every == 0:
            feedforward = comp_p[1] * comp_state[3] if comp_p[0] != 0.0 else 0.0
            feedback = pid(pid_state, pid_p, setpoint[k], measured, feedforward, by_hand[k], hand[k])
            if not by_hand[k]:
                feedforward = compensation(comp_state, comp_p, feedback, pid_state[5])
                pid_state[6] = min(max(feedback + feedforward, pid_p[5]), pid_p[6])
            output = pid_state[6]
        valve = output
        for i in range(ends[0]):
            valve = steps[i](states[state_at[i] : state_at[i + 1]], valve, p[p_at[i] : p_at[i + 1]])
        loaded = valve
        for i in range(ends[0], ends[1]):
            loaded = steps[i](states[state_at[i] : state_at[i + 1]], loaded, p[p_at[i] : p_at[i + 1]])
        # ring of the last `delay` + 2 inputs: the newest goes in, the two oldest act
        line[place] = loaded - rest
        late, later = line[(place + 2) % size], line[(place + 1) % size]
        place = (place + 1) % size
        for i in range(order):
            total = newer[i] * late + older[i] * later
            for j in range(order):
                total += decay[i, j] * x[j]
            new[i] = total
        x[:] = new
        out[0, k], out[1, k], out[2, k], out[3, k], out[4, k] = measured, output, valve, y, pid_state[5]
    return setpoint.size
