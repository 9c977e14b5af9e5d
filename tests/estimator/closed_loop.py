"""A small closed loop for tests: a process, play or stick at the valve, the ideal PID of Haegglund (2007), eq. 2."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from backlash_cli.record import FloatArray, LoopSettings, Record, record_from_arrays


@dataclass(frozen=True)
class Loop:
    """Ideal PID with measurement filter (3) on a two-lag process; all normalised, seconds."""

    K: float = 0.6
    Ti: float = 20.0
    Td: float = 0.0
    b: float = 0.0
    gain: float = 1.0
    lag: float = 12.0
    delay: float = 4.0
    noise: float = 0.001
    dead_band: float = 0.0
    stick: float = 0.0
    integrating: bool = False


def run(
    loop: Loop,
    samples: int = 4000,
    *,
    load: FloatArray | float = 0.0,
    setpoint: FloatArray | float = 0.5,
    seed: int = 0,
    start: float = 0.5,
) -> Record:
    """Simulate at 1 s; returns the record with output as the controller gave it and no settings."""
    rng = np.random.default_rng(seed)
    noise = loop.noise * rng.normal(size=samples)
    loads = np.broadcast_to(load, samples)
    setpoints = np.broadcast_to(setpoint, samples)
    Tf = loop.Td / 5 if loop.Td else loop.Ti / 10
    a, p = np.exp(-1.0 / Tf), np.exp(-1.0 / loop.lag)
    first = second = x1 = x2 = float(setpoints[0])
    bias = start
    integral, valve, half = 0.0, start, loop.dead_band / 2
    waiting = [0.0] * (int(loop.delay) + 1)
    pv, op = np.empty(samples), np.empty(samples)
    for k in range(samples):
        flow = waiting[k % len(waiting)]
        if loop.integrating:
            x1 += loop.gain * flow / loop.lag
            x2 = x1
        else:
            x1 = p * x1 + (1 - p) * (setpoints[0] + loop.gain * flow)
            x2 = p * x2 + (1 - p) * x1
        y = x2 + noise[k]
        first = a * first + (1 - a) * y
        before, second = second, a * second + (1 - a) * first
        error = setpoints[k] - second
        integral += error
        p_part = loop.b * (setpoints[k] - setpoints[0]) - (second - setpoints[0])
        u = bias + loop.K * (p_part + integral / loop.Ti - loop.Td * (second - before))
        if u - half > valve + loop.stick:
            valve = u - half
        elif u + half < valve - loop.stick:
            valve = u + half
        waiting[k % len(waiting)] = valve - start + loads[k]
        pv[k], op[k] = y, u
    return record_from_arrays(setpoints, pv, op, interval=1.0, settings=LoopSettings())


def load_steps(samples: int, size: float = 0.05, every: int = 400, seed: int = 1) -> FloatArray:
    """Random levels that change every `every` samples or so."""
    rng = np.random.default_rng(seed)
    level = np.zeros(samples)
    at = 0
    while at < samples:
        length = int(every * rng.uniform(0.6, 1.4))
        level[at : at + length] = rng.uniform(-size, size)
        at += length
    return level


def exception_reporting(values: np.ndarray, deviation: float) -> np.ndarray:
    """What a historian keeps that writes a value only when it has moved by more than `deviation`."""
    held = values.copy()
    for k in range(1, len(held)):
        if abs(values[k] - held[k - 1]) <= deviation:
            held[k] = held[k - 1]
    return held


def slow_loop(n: int = 6000, seed: int = 1, d: float = 0.05, K: float = 0.6, Ti: float = 8.0, Kp: float = 1.2,
              tau: float = 10.0, noise: float = 0.0005) -> Record:
    """A PI loop with one lag and a dead band at 1 s, walked sample by sample: independent of the simulator."""
    rng = np.random.default_rng(seed)
    y = integral = position = filtered = load = 0.0
    pv, op = np.empty(n), np.empty(n)
    for k in range(n):
        pv[k] = y + rng.normal(0, noise)
        filtered += (pv[k] - filtered) / 2.0
        integral += K / Ti * (0.5 - filtered)
        op[k] = integral - K * filtered
        position = min(max(position, op[k] - d / 2), op[k] + d / 2)
        if k % 1500 == 750:
            load += rng.choice([-0.1, 0.1])
        y += (Kp * (position + load) - y) / tau
    return record_from_arrays(0.5, pv, op, interval=1.0, settings=LoopSettings(K=K, Ti=Ti, Kp=Kp))
