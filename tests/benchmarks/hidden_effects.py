"""Loops with a hidden effect, drawn at random and played by the project's own simulator, with their oracle error."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from backlash_cli.effects import EFFECTS, Effect, Parameter, Stage
from backlash_cli.effects.fitting import Values
from backlash_cli.model.pipeline import Part, Shape, in_order, regressors
from backlash_cli.model.problem import problem_from_record
from backlash_cli.record import FloatArray, Record, SampleState
from backlash_cli.simulator import Applied, Controller, Process, Recorder, Scenario, Signal, simulate, use

BY_NAME = {effect.name: effect for effect in EFFECTS}
SINGLES = (
    "backlash", "stiction", "rate_limit", "saturation", "valve_characteristic", "dead_time", "second_lag",
    "load_step", "load_drift", "external_oscillation", "measured_disturbance", "quantization",
)  # fmt: skip
PAIRS = (
    ("backlash", "load_step"), ("backlash", "measured_disturbance"), ("backlash", "external_oscillation"),
    ("backlash", "dead_time"), ("backlash", "quantization"), ("stiction", "second_lag"), ("stiction", "load_drift"),
    ("dead_time", "external_oscillation"), ("second_lag", "measured_disturbance"),
    ("valve_characteristic", "dead_time"),
)  # fmt: skip


@dataclass(frozen=True)
class Case:
    """A simulated loop: what hides in it, its true parameters, and the error that the true model leaves."""

    record: Record
    effects: tuple[str, ...]
    truth: Mapping[str, Values]
    noise_sd: float
    oracle: float
    baseline: float
    lag: float
    kind: str = ""
    extra: Mapping[str, float] = field(default_factory=dict)


def installed_step(state: FloatArray, value: float, p: FloatArray) -> float:
    """Flow of a linear valve in series with a pipe, for one sample of travel."""
    return value / math.sqrt(p[0] + (1.0 - p[0]) * value * abs(value)) if p[0] < 1.0 else value


INSTALLED = Effect(
    name="installed",
    stage=Stage.VALVE,
    sentence="Linear valve in series with a pipe that takes most of the pressure drop.",
    source="Installed characteristic, e.g. Baumann, Control Valve Primer",
    parameters=(Parameter("share", "1", "share of pressure drop over the open valve", 1.0, 0.01, 1.0),),
    start=lambda p, interval, first: np.empty(0),
    step=installed_step,
)


def draw(seed: int, tier: str, kind: str | tuple[str, ...] | None = None) -> Case:
    """Return one loop of a tier ("clean" or "plant"); `kind` names its hidden effects, () for none."""
    random = np.random.default_rng([seed, 1 if tier == "clean" else 2])
    if kind is None:
        number = int(random.integers(0, 20))
        single, pair = (SINGLES[int(random.integers(12))],), PAIRS[int(random.integers(10))]
        kind = () if number < 3 else single if number < 15 else pair
    names = (kind,) if isinstance(kind, str) else tuple(kind)
    for _ in range(40):
        case = attempt(random, tier, names)
        if case is not None:
            return case
    raise RuntimeError(f"no visible {names} in 40 attempts")


def attempt(random: np.random.Generator, tier: str, names: tuple[str, ...]) -> Case | None:
    """Play one loop; None when an effect hardly shows, or the loop leaves its range."""
    clean = tier == "clean"
    log = lambda a, b: float(np.exp(random.uniform(np.log(a), np.log(b))))  # noqa: E731
    lag = log(10.0, 200.0)
    steps = [h for h in (0.5, 1.0, 2.0, 2.5, 4.0, 5.0, 8.0, 10.0) if 8.0 <= lag / h <= 40.0]
    h = float(random.choice(steps))
    n = int(random.integers(2100, 7900))
    # Kano's valve sticks again when a held output repeats, so it must see each output once
    duration, inner = n * h, h if "stiction" in names else h / 4.0
    gain = random.uniform(0.6, 2.0)
    delay = 0.0
    if "dead_time" in names:
        delay = lag * random.uniform(0.4, 1.2)
    elif not clean:
        delay = lag * random.uniform(0.3, 1.0)
    delay = inner * round(delay / inner)
    lag2 = lag * random.uniform(0.4, 0.95) if "second_lag" in names else 0.0
    closed = (lag + lag2) * random.uniform(0.4, 2.0) + delay
    Ti = (lag + lag2) * random.uniform(0.7, 1.4)
    K = Ti / (gain * (closed + delay))
    Td = lag * random.uniform(0.05, 0.2) if random.random() < 0.3 else 0.0
    weight, filtered = float(random.choice([0.0, 0.5, 1.0])), Ti * random.uniform(0.02, 0.1)
    controller = Controller(K=K, Ti=Ti, Td=Td, Tf=filtered, b=weight, low=0.0, high=1.0)
    noise = log(5e-4, 4e-3) if clean else log(5e-4, 2.5e-3)
    load_sd = noise * (random.uniform(0.3, 1.5) if clean else random.uniform(2.2, 6.0))
    load_time = lag * log(0.8, 4.5)
    level, output = random.uniform(0.35, 0.65), random.uniform(0.35, 0.65)
    times = np.cumsum(random.uniform(0.25, 1.0, 60) * duration / 16.0)
    times = times[times < duration * 0.98]
    # setpoint moves keep the output between its limits
    wish = np.clip(random.uniform(0.12, 0.88, times.size), None, None)
    values = level + gain * (wish - output) * random.uniform(0.3, 0.9)
    sizes = np.diff(np.concatenate([[level], values]))
    setpoint = Signal(level, (use("load_step", times=times, sizes=sizes),))
    load_gain = gain * math.sqrt(load_time / (load_time + lag))
    parts: list[Applied] = [use("random_load", sd=load_sd / load_gain, time_constant=load_time)]
    truth: dict[str, Values] = {}
    columns: dict[str, Signal] = {}
    recorder: tuple[Recorder, ...] = ()
    note = ""
    if "backlash" in names:
        truth["backlash"] = {"d": random.uniform(0.012, 0.06), "position": random.uniform(-1, 1)}
        parts.append(use("backlash", **truth["backlash"]))
    if "stiction" in names:
        S = random.uniform(0.02, 0.06)
        truth["stiction"] = {
            "S": S, "J": S * random.uniform(0.3, 0.95), "position": random.uniform(-1, 1),
            "restick": float(random.integers(2)),
        }  # fmt: skip
        parts.append(use("stiction", **truth["stiction"]))
    if "rate_limit" in names:
        truth["rate_limit"] = {"rate": log(0.02, 0.3) / lag}
        parts.append(use("rate_limit", **truth["rate_limit"]))
    if "saturation" in names:
        low = random.random() < 0.5
        truth["saturation"] = {"low" if low else "high": random.uniform(0.3, 0.5) if low else random.uniform(0.5, 0.7)}
        parts.append(use("saturation", **truth["saturation"]))
    if "valve_characteristic" in names:
        if random.random() < 0.35:
            note = "installed"
            share = random.uniform(0.1, 0.35)
            truth["valve_characteristic"] = {"share": share}
            parts.append(Applied(INSTALLED, INSTALLED.pack(share=share)))
        else:
            truth["valve_characteristic"] = {"curvature": random.uniform(1.3, 2.5) * random.choice([-1.0, 1.0])}
            parts.append(use("valve_characteristic", **truth["valve_characteristic"]))
    if "dead_time" in names:
        truth["dead_time"] = {"theta": delay}
    if "second_lag" in names:
        truth["second_lag"] = {"tau2": lag2}
    if "load_step" in names:
        count = int(random.integers(1, 4))
        at = np.sort(random.uniform(0.12, 0.9, count)) * duration
        at = h * np.rint(at / h)
        size = random.uniform(0.03, 0.1, count) * random.choice([-1.0, 1.0], count)
        truth["load_step"] = {"times": tuple(at.tolist()), "sizes": tuple(size.tolist())}
        parts.append(use("load_step", **truth["load_step"]))
    if "load_drift" in names:
        size = random.uniform(0.05, 0.2) * random.choice([-1.0, 1.0])
        note = str(random.choice(["ramp", "curve", "random_monotone"]))
        x = np.linspace(0.0, 1.0, 42)
        power = float(random.choice([0.5, 2.0, 3.0]))
        path = {"ramp": x, "curve": x**power}.get(note)
        if path is None:
            knots = np.concatenate([[0.0], np.cumsum(random.exponential(1.0, 12))])
            path = np.interp(x, np.linspace(0, 1, 13), knots / knots[-1])
        truth["load_drift"] = {
            "slope": size / (duration / 3600.0), "length": duration, "bends": tuple((size * (path - x))[1:-1].tolist())
        }  # fmt: skip
        parts.append(use("load_drift", **truth["load_drift"]))
    if "external_oscillation" in names:
        truth["external_oscillation"] = {
            "period": lag * log(3.0, 15.0), "amplitude": random.uniform(0.01, 0.03), "phase": random.uniform(-3, 3),
        }  # fmt: skip
        parts.append(use("external_oscillation", **truth["external_oscillation"]))
    if "measured_disturbance" in names or random.random() < 0.25:
        wander = use("random_load", sd=random.uniform(0.5, 9.0), time_constant=lag * log(0.5, 6.0))
        columns["DV1"] = Signal(random.uniform(-5, 50), (wander,))
    if "measured_disturbance" in names:
        sd = float(columns["DV1"].effects[0].p[0])
        truth["measured_disturbance"] = {"gain": random.uniform(0.015, 0.05) / sd * random.choice([-1.0, 1.0])}
        parts.append(use("measured_disturbance", column="DV1", **truth["measured_disturbance"]))
    parts.append(use("measurement_noise", density=noise**2 * inner))
    if "quantization" in names:
        step = max(random.uniform(0.0075, 0.018), 6.0 * noise)
        note = str(random.choice(["transmitter", "historian", "hold"] if not clean else ["transmitter", "historian"]))
        truth["quantization"] = {"step": step, "hold": float(note == "hold")}
        if note == "transmitter":
            parts.append(use("quantization", step=step))
        elif note == "historian":
            recorder = (Recorder(use("quantization", step=step), ("PV",)),)
        else:
            recorder = (Recorder(use("exception_compression", deviation=step), ("PV",)),)
    lags = (lag, lag2) if lag2 else (lag,)
    if delay > 0.0:
        # on the way from the valve: loads act on the process itself, as in the model
        parts.append(use("dead_time", theta=delay))
    scenario = Scenario(
        controller, Process(gain=gain, lags=lags), duration=duration, step=inner,
        effects=tuple(parts), setpoint=setpoint, output=output, sample_time=h, columns=columns, recorder=recorder,
        seed=int(random.integers(1 << 30)), name="loop",
    )  # fmt: skip
    try:
        record = simulate(scenario)
    except Exception:
        return None
    if record.output is None or np.mean((record.output <= 0.0) | (record.output >= 1.0)) > 0.1:
        return None
    told = {"K": K, "Ti": Ti, "Td": Td, "Kp": gain * (1 + random.uniform(-0.2, 0.2))}
    theta = None if clean or "dead_time" in names else delay * (1 + random.uniform(-0.15, 0.1))
    record = replace(record, settings=replace(record.settings, theta=theta, Tf=None, **told))
    record = replace(record, output=np.round(record.output, 6), measurement=np.round(record.measurement, 5))
    if not clean:
        record = damaged(record, random)
    effects = tuple(n for n in SINGLES if n in names)
    case = judged(record, effects, truth, noise, lag, delay, note)
    return case and replace(case, extra={"gain": gain})


def damaged(record: Record, random: np.random.Generator) -> Record:
    """Drop rows and spoil cells, as exports do."""
    n = len(record)
    keep = np.ones(n, dtype=bool)
    for _ in range(int(random.integers(1, 6))):
        at = int(random.integers(10, n - 60))
        keep[at : at + int(random.integers(2, 40))] = False
    rows = np.flatnonzero(keep)
    state = record.state[rows].copy()
    measurement = record.measurement[rows].copy()
    bad = random.choice(rows.size, 6, replace=False)
    state[bad], measurement[bad] = SampleState.MISSING, np.nan
    pick = {k: v[rows] for k, v in record.disturbances.items()}
    output = None if record.output is None else record.output[rows]
    return replace(
        record, index=record.index[rows], setpoint=record.setpoint[rows], measurement=measurement, output=output,
        state=state, disturbances=pick,
    )  # fmt: skip


def judged(
    record: Record,
    effects: tuple[str, ...],
    truth: Mapping[str, Values],
    noise: float,
    lag: float,
    delay: float,
    note: str,
) -> Case | None:
    """Return the case with its oracle errors, None when one of its effects hardly lowers the error."""
    problem = problem_from_record(record)

    played = {"valve_characteristic": INSTALLED} if note == "installed" else {}

    def error(names: tuple[str, ...]) -> float:
        shown = [n for n in names if n not in ("dead_time", "quantization")]
        column = {"measured_disturbance": "DV1"}
        parts = in_order([Part(played.get(n, BY_NAME[n]), truth[n], column.get(n, "")) for n in shown])
        late = delay if "dead_time" in names or "dead_time" not in effects else 0.0
        X = regressors(problem, Shape(lag, late, parts))[problem.used]
        y = problem.measurement[problem.used]
        c, *_ = np.linalg.lstsq(X, y, rcond=None)
        return float(np.sqrt(np.mean((y - X @ c) ** 2)))

    whole = error(effects)
    base = error(())
    physical = [n for n in effects if n != "quantization"]
    for n in physical:
        if error(tuple(m for m in effects if m != n)) < 1.3 * whole:
            return None
    return Case(record, effects, truth, noise, whole, base, lag, note)
