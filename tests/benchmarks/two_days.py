"""Two days of one loop, drawn at random: the same process, controller and valve, other setpoint moves and loads."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from backlash_cli.errors import BacklashError
from backlash_cli.record import Record
from backlash_cli.simulator import Applied, Controller, Process, Scenario, Signal, simulate, use

LASTING = ("backlash", "stiction", "valve_characteristic", "second_lag", "measured_disturbance", "none")
# what comes on top on the first day, and is gone or elsewhere on the second
PASSING = ("", "", "load_step", "load_drift", "external_oscillation")
DAY, INTERVAL = 7200.0, 2.0


@dataclass(frozen=True, eq=False)
class TwoDays:
    """Two records of one loop. kind: what is wrong with it for good, and what with its load on the first day."""

    monday: Record
    tuesday: Record
    kind: str


def two_days(seed: int) -> TwoDays:
    """Return a pair drawn from `seed`."""
    for attempt in range(100):
        rng = np.random.default_rng([seed, attempt, 5])
        lasting, passing = str(rng.choice(LASTING)), str(rng.choice(PASSING))
        lag, gain = float(rng.uniform(15.0, 40.0)), float(rng.uniform(0.7, 1.8))
        parts: list[Applied] = []
        if lasting == "backlash":
            parts.append(use("backlash", d=float(rng.uniform(0.015, 0.05))))
        if lasting == "stiction":
            S = float(rng.uniform(0.02, 0.05))
            parts.append(use("stiction", S=S, J=S * float(rng.uniform(0.3, 0.9))))
        if lasting == "valve_characteristic":
            parts.append(use("valve_characteristic", curvature=float(rng.uniform(1.3, 2.5) * rng.choice([-1, 1]))))
        if lasting == "measured_disturbance":
            parts.append(use("measured_disturbance", column="DV1", gain=float(rng.uniform(0.02, 0.05))))
        lags = (lag, lag * float(rng.uniform(0.5, 0.9))) if lasting == "second_lag" else (lag,)
        Ti = sum(lags) * float(rng.uniform(0.8, 1.3))
        controller = Controller(K=Ti / (gain * 1.5 * sum(lags)), Ti=Ti)
        days = []
        for day in (0, 1):
            own = np.random.default_rng([seed, attempt, 6, day])
            load = [use("random_load", sd=float(own.uniform(0.002, 0.006)), time_constant=3.0 * lag)]
            load += _passing(passing, day, own)
            days.append(_day(controller, Process(gain=gain, lags=lags), (*parts, *load), own, day, seed))
        if all(day is not None for day in days):
            return TwoDays(days[0], days[1], "+".join(k for k in (lasting, passing) if k))  # type: ignore[arg-type]
    raise AssertionError(f"no pair in 100 draws from seed {seed}")


def _passing(kind: str, day: int, rng: np.random.Generator) -> list[Applied]:
    """Loads of one day: steps and drift on the first only, a swing on both but with another phase."""
    if kind == "load_step" and day == 0:
        times = np.sort(rng.uniform(0.15, 0.85, 2)) * DAY
        return [use("load_step", times=times.tolist(), sizes=(rng.uniform(0.04, 0.08, 2) * [1, -1]).tolist())]
    if kind == "load_drift" and day == 0:
        return [use("load_drift", slope=float(rng.uniform(0.03, 0.08)))]
    if kind == "external_oscillation":
        return [use("external_oscillation", period=190.0, amplitude=0.015, phase=float(rng.uniform(-3, 3)))]
    return []


def _day(
    controller: Controller, process: Process, effects: tuple[Applied, ...], rng: np.random.Generator, day: int,
    seed: int,
) -> Record | None:
    """Play one day; None when the loop leaves its range."""
    times = np.cumsum(rng.uniform(200.0, 700.0, 60))
    times = times[times < DAY]
    level = rng.uniform(0.35, 0.65)
    wanted = np.clip(level + rng.normal(0.0, 0.06, times.size), 0.2, 0.8)
    moves = use("load_step", times=times.tolist(), sizes=np.diff(np.concatenate([[level], wanted])).tolist())
    wander = Signal(20.0, (use("random_load", sd=1.0, time_constant=150.0),))
    try:
        record = simulate(Scenario(
            controller, process, duration=DAY, step=INTERVAL, output=0.5, setpoint=Signal(level, (moves,)),
            effects=(*effects, use("measurement_noise", density=0.001**2 * INTERVAL)), columns={"DV1": wander},
            seed=2 * seed + day, name=f"D{seed:03d}", start=1773734400.0 + 86400.0 * day,
        ))
    except BacklashError:
        return None
    if record.output is None or np.ptp(record.measurement) > 0.95:
        return None
    clipped = np.mean((record.output <= 0.0) | (record.output >= 1.0))
    return replace(record, measurement=np.round(record.measurement, 5)) if clipped < 0.01 else None
