"""Loops drawn at random around the Åström-Hägglund test batch, in nine kinds of load and setpoint motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from backlash_cli.errors import BacklashError
from backlash_cli.record import Record
from backlash_cli.simulator import Controller, Process, Scenario, Signal, simulate, use
from backlash_cli.simulator.scenario import Applied

LOADS = ("steps", "coloured", "cascade", "drift", "quiet")
CONTROLS = ("sine", "square", "fastsp", "walk")  # shapes that fool a test
SIZES = (0.0, 0.0, 0.0, 0.01, 0.02, 0.03, 0.05, 0.08)


@dataclass(frozen=True, eq=False)
class RandomLoop:
    """One simulated loop and its truth: dead band d [span of output], kind of motion, the range OP covered."""

    record: Record
    d: float
    kind: str
    process: str
    output_range: float


def draw(seed: int, kind: str | None = None, d: float | None = None, samples: int | None = None) -> RandomLoop:
    """Return a loop drawn from `seed`; `kind` and `d` [span] are drawn too where they are not given.

    samples: length at 1 s, 250 Ti where it is not given (4,000 to 14,400).
    """
    for attempt in range(100):
        rng = np.random.default_rng((seed, attempt))
        which = kind or str(rng.choice(LOADS + CONTROLS))
        size = float(rng.choice(SIZES)) if d is None else d
        name, unit = _process(rng)
        Ti_unit, K_unit = _tuning(unit, rng)
        scale = float(np.clip(rng.choice([2.0, 3.0, 4.0, 6.0, 8.0]), 2.2 / Ti_unit, 100.0 / Ti_unit))
        gain = rng.uniform(0.7, 2.2)
        Ti = scale * Ti_unit
        length = samples or int(np.clip(250 * Ti, 4000, 14400))
        process = Process(gain=gain, lags=tuple(scale * lag for lag in unit.lags), dead_time=scale * unit.dead_time,
                          numerator=tuple(c * scale ** (len(unit.numerator) - 1 - i)
                                          for i, c in enumerate(unit.numerator)))
        loads, setpoint = _motion(which, Ti, length, rng)
        noise = 0.0005 * 10 ** rng.uniform(0, 1)
        valve = (use("backlash", d=size),) if size else ()
        scenario = Scenario(
            Controller(K=K_unit / gain, Ti=Ti), process, duration=float(length), step=1.0, output=0.5,
            effects=(*valve, *loads, use("measurement_noise", density=noise**2)), setpoint=Signal(0.5, setpoint),
            seed=seed, name=f"R{seed:04d}",
        )
        try:
            record = simulate(scenario)
        except BacklashError:  # a tuning that is not stable on this process: draw again
            continue
        assert record.output is not None
        if np.ptp(record.measurement) < 1.5:
            return RandomLoop(record, size, which, name, float(np.ptp(record.output)))
    raise AssertionError(f"no stable loop in 100 draws from seed {seed}")


def _process(rng: np.random.Generator) -> tuple[str, Process]:
    family = str(rng.choice(["P1", "P2", "P3", "P4", "P5", "P8"]))
    if family in ("P1", "P2"):
        T = float(rng.choice([0.5, 1.0, 2.0, 4.0, 8.0]))
        return f"{family} T={T}", Process(lags=(T,) * (1 if family == "P1" else 2), dead_time=1.0)
    if family == "P3":
        T = float(rng.choice([0.2, 0.5, 1.0]))
        return f"P3 T={T}", Process(lags=(1.0, T, T))
    if family == "P4":
        n = int(rng.integers(3, 9))
        return f"P4 n={n}", Process(lags=(1.0,) * n)
    if family == "P5":
        a = float(rng.choice([0.3, 0.5, 0.7, 0.9]))
        return f"P5 a={a}", Process(lags=(1.0, a, a * a, a**3))
    a = float(rng.choice([0.1, 0.3, 0.5]))
    return f"P8 a={a}", Process(lags=(1.0, 1.0, 1.0), numerator=(-a, 1.0))


def _tuning(unit: Process, rng: np.random.Generator) -> tuple[float, float]:
    """Ti from the residence time, K for a largest sensitivity between 1.25 and 1.7."""
    inverse = -unit.numerator[0] if len(unit.numerator) == 2 else 0.0
    total = sum(unit.lags) + unit.dead_time + inverse
    Ti = total * (0.65 + 0.75 * max(unit.lags) / total) * rng.uniform(0.93, 1.07)
    omega = np.logspace(-2.5, 1.5, 300) * 3.0 / total
    open_loop = unit.response(omega) / (1 + 1j * omega * Ti / 10) ** 2 * (1 + 1 / (1j * omega * Ti))
    Ms, low, high = rng.uniform(1.25, 1.7), 0.02, 20.0
    for _ in range(40):
        K = float(np.sqrt(low * high))
        low, high = (low, K) if np.max(1 / np.abs(1 + K * open_loop)) > Ms else (K, high)
    return float(Ti), low


def _motion(kind: str, Ti: float, n: int, rng: np.random.Generator) -> tuple[tuple[Applied, ...], tuple[Applied, ...]]:
    """Effects on the load and on the setpoint."""
    seldom = max(350.0, 50.0 * Ti) * rng.uniform(0.7, 1.3)
    if kind == "steps":
        return (_steps(n, seldom, rng.uniform(0.03, 0.07), rng),), ()
    if kind == "coloured":
        return (_levels(_smooth(n, rng.uniform(2.0, 5.0) * Ti, rng) * rng.uniform(0.007, 0.015), Ti),), ()
    if kind == "cascade":
        slow = use("external_oscillation", amplitude=rng.uniform(0.003, 0.01), period=rng.uniform(20.0, 60.0) * Ti)
        return (), (_steps(n, max(250.0, 20.0 * Ti), 0.02, rng), slow)
    if kind == "drift":
        slope = use("load_drift", slope=rng.uniform(-0.1, 0.1) * 3600.0 / n)
        return (_steps(n, seldom, rng.uniform(0.03, 0.07), rng), slope), ()
    if kind == "quiet":
        return (_steps(n, seldom, 0.005, rng),), ()
    if kind == "sine":
        swing = use("external_oscillation", amplitude=rng.uniform(0.012, 0.035), period=rng.uniform(15.0, 40.0) * Ti)
        return (swing,), ()
    if kind == "square":
        return (_square(n, rng.uniform(0.012, 0.04), rng.uniform(14.0, 30.0) * Ti),), ()
    if kind == "fastsp":
        return (), (_square(n, 0.02 * rng.uniform(0.8, 1.2), rng.uniform(6.0, 14.0) * Ti),)
    walk = np.cumsum(rng.normal(size=n)) * rng.uniform(0.026, 0.078) / np.sqrt(n)
    return (_levels(walk, Ti),), ()


def _steps(n: int, mean: float, size: float, rng: np.random.Generator) -> Applied:
    times = np.cumsum(mean * (0.3 + 0.7 * rng.exponential(size=int(n / (0.3 * mean)) + 2)))
    times = np.concatenate([times[times < n], [float(n)]])
    return use("load_step", times=times, sizes=np.diff(rng.normal(0.0, size, len(times)), prepend=0.0))


def _square(n: int, size: float, period: float) -> Applied:
    times = np.arange(0.0, n, period / 2.0)
    sizes = 2.0 * size * (-1.0) ** np.arange(len(times))
    sizes[0] = size
    return use("load_step", times=times, sizes=sizes)


def _levels(load: np.ndarray, Ti: float) -> Applied:
    """A load of any shape, held over an eighth of Ti."""
    every = max(1, int(Ti / 8.0), len(load) // 2000)
    held = load[::every]
    return use("load_step", times=np.arange(0.0, len(load), every), sizes=np.diff(held, prepend=0.0))


def _smooth(n: int, T: float, rng: np.random.Generator) -> np.ndarray:
    from scipy.signal import lfilter

    a = 1.0 - np.exp(-1.0 / T)
    x = lfilter([a], [1, a - 1], lfilter([a], [1, a - 1], rng.normal(size=n)))
    return np.asarray(x / x.std())
