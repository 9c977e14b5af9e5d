"""The inner loop of the simulator, compiled once by numba and cached on disk.

All compiled code of the simulator is in this file because numba notices a change only in the file of a kernel.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numba import types

from ..effects.compiled import FLOATS, STEP_POINTER, kernel

SLOTS = 16
PID_STATE = 7
COMPENSATOR_STATE = 4
MATRIX = types.Array(types.float64, 2, "C")
INTEGERS = types.Array(types.int64, 1, "C")
FLAGS = types.Array(types.boolean, 1, "C")
POINTERS = types.UniTuple(STEP_POINTER, SLOTS)


@numba.njit(cache=True)
def pid(
    state: Any, p: Any, setpoint: float, measurement: float, feedforward: float, by_hand: bool, hand: float
) -> float:
    """One controller sample: returns the feedback part; state: [x1, yf, s1, sf, integral, error, output].

    The new sample counts as the mean over the interval before it. Away from automatic the integral part follows,
    so that the return is without a bump; `hand` nan holds the output.
    """
    gain, integral, derivative, b, c, low, high, windup, a, w = (
        p[0], p[1], p[2], p[3], p[4], p[5], p[6], p[7], p[8], p[9],
    )  # fmt: skip
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


@numba.njit(cache=True)
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
    if signal > hysteresis:
        state[3] = 1.0
    elif signal < -hysteresis:
        state[3] = -1.0
    return half * state[3]


@kernel(POINTERS, INTEGERS, INTEGERS, INTEGERS, FLOATS, FLOATS, MATRIX, FLOATS, FLOATS, FLOATS, FLOATS, FLOATS, FLOATS,
        FLOATS, FLOATS, types.int64, FLOATS, FLAGS, FLOATS, types.float64, types.float64, types.float64, MATRIX,
        returns=types.int64)
def closed_loop(steps: Any, state_at: Any, p_at: Any, ends: Any, states: Any, p: Any, decay: Any, newer: Any,
                older: Any, readout: Any, line: Any, pid_p: Any, pid_state: Any, comp_p: Any, comp_state: Any,
                every: int, setpoint: Any, by_hand: Any, hand: Any, level: float, rest: float, limit: float,
                out: Any) -> int:
    """Run the loop; fills out (5, samples): measurement, output, valve position, process output, filtered error.

    ends: [n valve and process effects, n with load effects, n with sensor effects] into the effects' tables.
    line: delay line of process inputs. level, rest: process output and input at rest. Returns the sample at
    which the process output left level +- limit, or the number of samples.
    """  # fmt: skip
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
        for i in range(order):
            x[i] = new[i]
        out[0, k] = measured
        out[1, k] = output
        out[2, k] = valve
        out[3, k] = y
        out[4, k] = pid_state[5]
    return setpoint.size
