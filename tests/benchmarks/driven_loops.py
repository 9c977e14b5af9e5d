"""Loops that move by themselves: driven by loads at a fixed setpoint, cycling by friction, by tuning or from outside.

Drawn at random and played by the project's own simulator. Processes are those of `random_loops`: of high order, with
dead time or inverse response, so that the plain model is never exact.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from backlash_cli.errors import BacklashError
from backlash_cli.record import Record
from backlash_cli.simulator import Controller, Process, Scenario, Signal, simulate, use
from backlash_cli.simulator.scenario import Applied

from .random_loops import _process, _tuning
from .random_loops import draw as draw_loop

# what moves the loop -> may its valve have friction?
LOADS = ("steps", "coloured", "drift", "quiet", "cascade")
CYCLES = ("sticking", "tight", "outside", "level")
KINDS = LOADS + CYCLES


@dataclass(frozen=True, eq=False)
class DrivenLoop:
    """One simulated loop: kind of motion, dead band d and slip jump J [span of output], 0 for a healthy valve."""

    record: Record
    kind: str
    d: float
    J: float
    process: str
    steps: bool  # step loads were played


def draw(seed: int, kind: str | None = None, *, friction: bool | None = None) -> DrivenLoop:
    """Return a loop drawn from `seed`; kind and whether its valve has friction are drawn where they are not given."""
    pick = np.random.default_rng([seed, 31])
    which = kind or str(pick.choice(KINDS))
    sticks = bool(pick.random() < 0.5) if friction is None else friction
    if which in LOADS:
        d = float(pick.uniform(0.01, 0.06)) if sticks else 0.0
        loop = draw_loop(seed, which, d)
        return DrivenLoop(loop.record, which, d, 0.0, loop.process, which in ("steps", "drift", "quiet"))
    for attempt in range(100):
        found = _cycling(np.random.default_rng([seed, 32, attempt]), which, sticks, seed)
        if found is not None:
            return found
    raise AssertionError(f"no {which} loop in 100 draws from seed {seed}")


def _cycling(rng: np.random.Generator, kind: str, sticks: bool, seed: int) -> DrivenLoop | None:
    """Return a loop that cycles, None when this draw does not."""
    name, unit = _process(rng)
    Ti_unit, K_unit = _tuning(unit, rng)
    scale = float(np.clip(rng.choice([2.0, 4.0, 8.0]), 2.2 / Ti_unit, 60.0 / Ti_unit))
    gain = rng.uniform(0.7, 2.2)
    Ti = scale * Ti_unit
    samples = int(np.clip(rng.uniform(60.0, 200.0) * Ti, 1200, 8000))
    process = Process(gain=gain, lags=tuple(scale * lag for lag in unit.lags), dead_time=scale * unit.dead_time,
                      numerator=tuple(c * scale ** (len(unit.numerator) - 1 - i) for i, c in enumerate(unit.numerator)))
    K = K_unit / gain
    noise = 0.0005 * 10 ** rng.uniform(0, 0.8)
    S = rng.uniform(0.015, 0.06)
    J = S * rng.uniform(0.3, 0.95)
    parts: list[Applied] = [use("random_load", sd=rng.uniform(0.001, 0.004), time_constant=rng.uniform(2.0, 8.0) * Ti)]
    if kind == "level":
        # a tank: PI on an integrator cycles with any dead band
        Ti = scale * rng.uniform(8.0, 20.0)
        process = Process(gain=rng.uniform(0.3, 1.0) / Ti, lags=(scale,), integrating=True)
        K, samples = rng.uniform(1.2, 2.5), int(np.clip(120.0 * Ti, 2000, 8000))
        gain = process.gain
        J = 0.0
        parts = [use("random_load", sd=rng.uniform(0.003, 0.008), time_constant=rng.uniform(2.0, 8.0) * Ti)]
        name = "level"
        K /= gain * Ti
    if kind == "tight":
        K *= rng.uniform(1.6, 3.0)
    if kind == "outside":
        parts.append(use("external_oscillation", amplitude=rng.uniform(0.01, 0.03), period=rng.uniform(4.0, 20.0) * Ti))
    d = 0.0
    if sticks:
        d = S
        parts.append(use("stiction", S=S, J=J) if J else use("backlash", d=S))
    parts.append(use("measurement_noise", density=noise**2))
    scenario = Scenario(
        Controller(K=K, Ti=Ti), process, duration=float(samples), step=1.0, output=0.5, effects=tuple(parts),
        setpoint=Signal(0.5, ()), seed=int(rng.integers(1 << 30)), name=f"C{seed:04d}",
    )
    try:
        record = simulate(scenario)
    except BacklashError:
        return None
    if record.output is None or np.ptp(record.measurement) > 0.9 or np.ptp(record.output) < max(1.2 * d, 0.02):
        return None
    if np.mean((record.output <= 0.0) | (record.output >= 1.0)) > 0.02:
        return None
    return DrivenLoop(record, kind, d, J if sticks else 0.0, name, False)
