"""Loops that oscillate for a known reason: a sticking valve, a gap, the load, the setpoint, or the tuning."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from backlash_cli.errors import BacklashError
from backlash_cli.record import Record
from backlash_cli.simulator import Controller, Process, Scenario, Signal, simulate, use
from backlash_cli.simulator.scenario import Applied

from .random_loops import _process, _square, _tuning

VALVE = ("stick", "stick and gap", "gap, tight", "level, gap", "level, stick")  # the valve makes the cycle
OTHER = ("sine", "square", "sawtooth", "setpoint", "tight")  # a healthy valve: something else does
CAUSES = VALVE + OTHER


@dataclass(frozen=True, eq=False)
class CyclingLoop:
    """One simulated loop, the cause of its oscillation, and S and J of the valve [span] (0: healthy)."""

    record: Record
    cause: str
    S: float
    J: float
    process: str


def draw(seed: int, cause: str) -> CyclingLoop:
    """Return a loop drawn from `seed` that oscillates because of `cause`."""
    for attempt in range(200):
        found = _drawn(np.random.default_rng([seed, CAUSES.index(cause), attempt]), cause)
        if found is not None:
            return found
    raise AssertionError(f"no loop with {cause} in 200 draws from seed {seed}")


def _drawn(rng: np.random.Generator, cause: str) -> CyclingLoop | None:
    name, unit = _process(rng)
    Ti_unit, K_unit = _tuning(unit, rng)
    scale = float(np.clip(rng.choice([2.0, 4.0, 8.0]), 2.2 / Ti_unit, 40.0 / Ti_unit))
    gain, Ti = rng.uniform(0.7, 2.2), scale * Ti_unit
    process = Process(gain=gain, lags=tuple(scale * lag for lag in unit.lags), dead_time=scale * unit.dead_time,
                      numerator=tuple(c * scale ** (len(unit.numerator) - 1 - i) for i, c in enumerate(unit.numerator)))
    K = K_unit / gain * rng.uniform(0.7, 1.3)
    S, J = float(rng.uniform(0.01, 0.06)), 0.0
    if cause.startswith("level"):
        name, Ti = "level", scale * rng.uniform(8.0, 20.0)
        process = Process(gain=rng.uniform(0.3, 1.0) / Ti, lags=(scale,), integrating=True)
        K = rng.uniform(1.2, 2.5) / (process.gain * Ti)
    samples = int(np.clip(rng.uniform(60.0, 200.0) * Ti, 1500, 8000))
    parts: list[Applied] = [use("random_load", sd=rng.uniform(0.0005, 0.003), time_constant=rng.uniform(2.0, 8.0) * Ti)]
    setpoint: tuple[Applied, ...] = ()
    if "gap" in cause and "stick" not in cause:
        parts.append(use("backlash", d=S))
    if "tight" in cause:
        K *= rng.uniform(1.7, 2.6) if cause == "tight" else rng.uniform(2.0, 3.5)
        parts[0] = use("random_load", sd=rng.uniform(0.002, 0.006), time_constant=rng.uniform(1.0, 4.0) * Ti)
    if "stick" in cause:
        J = S if cause == "stick" else S * float(rng.uniform(0.3, 0.8))
        parts.append(use("stiction", S=S, J=J))
    size, period = rng.uniform(0.01, 0.03), rng.uniform(4.0, 25.0) * Ti
    if cause == "sine":
        parts.append(use("external_oscillation", amplitude=size, period=period))
    if cause == "square":
        parts.append(_square(samples, size, period))
    if cause == "sawtooth":
        parts.append(_sawtooth(samples, size, period))
    if cause == "setpoint":
        setpoint = (use("external_oscillation", amplitude=size, period=period),)
    noise = 0.0005 * 10 ** rng.uniform(0, 0.8)
    parts.append(use("measurement_noise", density=noise**2))
    scenario = Scenario(
        Controller(K=K, Ti=Ti), process, duration=float(samples), step=1.0, output=0.5, effects=tuple(parts),
        setpoint=Signal(0.5, setpoint), seed=int(rng.integers(1 << 30)), name="cycling",
    )
    try:
        record = simulate(scenario)
    except BacklashError:
        return None
    if record.output is None or np.ptp(record.measurement) > 0.9:
        return None
    if np.mean((record.output <= 0.0) | (record.output >= 1.0)) > 0.02:
        return None
    valve = any(word in cause for word in ("gap", "stick"))
    if valve and np.ptp(record.output) < 1.2 * S:
        return None
    return CyclingLoop(record, cause, S if valve else 0.0, J, name)


def _sawtooth(n: int, size: float, period: float) -> Applied:
    """A load that rises steadily and falls back at once, as a tank that is emptied in batches makes it."""
    every = max(1, int(period / 24.0))
    times = np.arange(0.0, n, every)
    levels = 2.0 * size * ((times / period) % 1.0 - 0.5)
    return use("load_step", times=times, sizes=np.diff(levels, prepend=0.0))
