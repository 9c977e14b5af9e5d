"""Random loops around the test batch of Astrom and Hagglund (Advanced PID Control, 2006, eq. 7.2), with dead band."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from backlash_cli.simulator import Controller, Manual, Process, Scenario, Signal, trace, use

TI = 30.0  # seconds: every loop is scaled in time so that its controller has about this integral time


@dataclass(frozen=True)
class Loop:
    """One loop of the batch; family: number of the process in the batch. noise: standard deviation at 1 s."""

    family: int
    process: Process
    controller: Controller
    d: float
    noise: float


def draw_process(rng: np.random.Generator) -> tuple[int, dict]:
    """Draw one of the stable processes of the batch (P1 to P5, P7 to P9), parameters at random in its range."""

    def between(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    family = int(rng.choice([1, 2, 3, 4, 5, 7, 8, 9]))
    T, a = between(0.1, 10.0), rng.uniform(0.1, 0.9)
    if family == 1:
        return family, {"lags": (T,), "dead_time": 1.0}
    if family == 2:
        return family, {"lags": (T, T), "dead_time": 1.0}
    if family == 3:
        return family, {"lags": (1.0, T, T)}
    if family == 4:
        return family, {"lags": (1.0,) * int(rng.integers(3, 9))}
    if family == 5:
        return family, {"lags": (1.0, a, a**2, a**3)}
    if family == 7:
        lag = rng.uniform(0.01, 0.95)
        return family, {"lags": (between(1.0, 10.0), lag), "dead_time": 1.0 - lag}
    if family == 8:
        return family, {"lags": (1.0, 1.0, 1.0), "numerator": (-rng.uniform(0.1, 1.1), 1.0)}
    t = rng.uniform(0.1, 1.0)
    return family, {"lags": (1.0,), "denominator": (t * t, 1.4 * t, 1.0)}


def two_point(process: Process) -> tuple[float, float]:
    """Return dead time L and lag T of the step response from its 28 and 63 % points (Smith 1972)."""
    total = sum(process.lags) + process.dead_time + 2.0
    hand = Manual(0.0, 10.0 * total, 1.0)
    run = trace(Scenario(Controller(1.0, 1.0), process, 8.0 * total, total / 500.0, manual=(hand,)))
    share = run.process_output / process.gain
    t28, t63 = (run.time[int(np.argmax(share > level))] for level in (0.283, 0.632))
    T = max(1.5 * (t63 - t28), 0.02 * total)
    return max(float(t63) - T, 0.05 * total), T


def tuned(process: Process, derivative: bool, rng: np.random.Generator) -> Controller:
    """Return the AMIGO controller (Advanced PID Control, section 7.5), detuned at random as in a plant."""
    L, T = two_point(process)
    if derivative:
        K = (0.2 + 0.45 * T / L) / process.gain
        Ti, Td = (0.4 * L + 0.8 * T) / (L + 0.1 * T) * L, 0.5 * L * T / (0.3 * L + T)
    else:
        K = (0.15 + (0.35 - L * T / (L + T) ** 2) * T / L) / process.gain
        Ti, Td = 0.35 * L + 13.0 * L * T**2 / (T**2 + 12.0 * L * T + 7.0 * L**2), 0.0
    return Controller(K * rng.uniform(0.6, 1.2), Ti * rng.uniform(0.8, 1.5), Td)


def draw_loop(rng: np.random.Generator) -> Loop:
    """Draw process, gain, controller, dead band of 1 to 8 % and measurement noise of 0.02 to 0.3 %."""
    family, shape = draw_process(rng)
    process = Process(gain=float(rng.uniform(0.5, 3.0)), **shape)
    controller = tuned(process, bool(rng.random() < 0.4), rng)
    slower = TI / controller.Ti

    def scaled(coefficients: tuple[float, ...]) -> tuple[float, ...]:
        powers = range(len(coefficients) - 1, -1, -1)
        return tuple(c * slower**p for c, p in zip(coefficients, powers, strict=True))

    process = Process(process.gain, tuple(slower * lag for lag in process.lags), slower * process.dead_time, False,
                      scaled(process.numerator), scaled(process.denominator))
    noise = float(np.exp(rng.uniform(np.log(0.0002), np.log(0.003))))
    return Loop(family, process, Controller(controller.K, TI, slower * controller.Td), float(rng.uniform(0.01, 0.08)),
                noise)


def recording(loop: Loop, rng: np.random.Generator, hours: float = 4.0, seed: int = 0) -> Scenario:
    """Return a scenario in which loads come as steps, as slow random motion, or with setpoint moves, at random."""
    duration = 3600.0 * hours
    kind = int(rng.integers(3))
    effects = [use("backlash", d=loop.d), use("measurement_noise", density=loop.noise**2)]
    setpoint = Signal(0.5)
    if kind == 0:
        n = int(5 * hours)
        times, signs = np.sort(rng.uniform(0.0, duration, n)), rng.choice([-1.0, 1.0], n)
        effects.append(use("load_step", times=times.tolist(), sizes=(rng.uniform(0.02, 0.1, n) * signs).tolist()))
    elif kind == 1:
        sd, time_constant = float(rng.uniform(0.01, 0.05)), float(rng.uniform(100.0, 600.0))
        effects.append(use("random_load", sd=sd, time_constant=time_constant))
    else:
        n = int(3 * hours)
        times, signs = np.sort(rng.uniform(0.0, duration, n)), np.where(np.arange(n) % 2, -1.0, 1.0)
        moves = use("load_step", times=times.tolist(), sizes=(rng.uniform(0.02, 0.05, n) * signs).tolist())
        setpoint = Signal(0.5, (moves,))
        effects.append(use("random_load", sd=0.01, time_constant=300.0))
    return Scenario(loop.controller, loop.process, duration, 0.5, tuple(effects), setpoint, 0.5, record_interval=1.0,
                    seed=seed)
