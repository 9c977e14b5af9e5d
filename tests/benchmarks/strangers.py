"""Recordings of plants this project did not design for: python -m tests.benchmarks.strangers N [--seed S].

A plant simulator that shares nothing with `backlash_cli`: valve, actuator, process and controller are integrated in
time as they stand in a plant, with steps of 0.2 to 1 s (friction: 2 ms), and the historian keeps what it would keep.
Percent of span everywhere inside; engineering units in what `loop` hands out.

    valve:      linear; equal percentage in a line that takes its share of the pressure drop, linearised or not;
                actuator lag; play, also of a gap that grows with the travel; split range; friction (Karnopp, LuGre)
    process:    one to four lags, dead time, integrator, a fast path beside the slow one
    controller: PI and PID, lambda tuning with spread, anti-windup, limits, feed-forward, gap control, manual stretches
    truth:      what was put in, and what the valve did: `crossings` counts how often the stem crossed its whole gap

With `--kind manual` an operator tests each valve in manual, at a more or less quiet time (`manual_moves`).
With `--compressed` the historian keeps of PV and OP what a swinging door leaves of them.

`main` scans the loops through the public functions of the program and prints how the verdicts fared, by family;
with --write DIR the exports stay. The laws are in `strange_plant`.
"""

from __future__ import annotations

import argparse
import json
import math
import tempfile
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd
from scipy.signal import lfilter

from .strange_plant import KARNOPP, LUGRE, control_loop, exception_report, gain_margin, reversals, swinging_door

Array = npt.NDArray[np.float64]
Random = np.random.Generator
FAMILIES = {"generic": 31, "flow": 21, "pressure": 21, "temperature": 17, "level": 10}
HOURS = {1.0: 1, 2.0: 1, 3.0: 2, 4.0: 2, 6.0: 1, 8.0: 1, 12.0: 2, 24.0: 1}
INTERVALS = {1.0: 4, 2.0: 2, 5.0: 3, 10.0: 2}
VALVES = {
    "healthy": {"ideal": 42, "eq": 24, "lag": 19, "lag+eq": 11, "split": 4},
    "worn": {"play": 28, "play+lag": 22, "play+eq": 20, "play+eq+lag": 20, "play+travel": 6, "play+split": 4},
    "stick": {"stick": 60, "stick+eq": 30, "stick+oneway": 10},
}
LOADS = {"rw": 14, "ou": 17, "steps": 15, "sine": 14, "ramps": 11, "diurnal": 8, "spikes": 6, "square": 5, "mixed": 12}
TESTS = {"uudd": 4, "uuddu": 2, "uudduu": 3, "uudduudd": 3, "uuudddu": 2, "udud": 2, "udududud": 1, "any": 2, "ud": 1,
         "uuu": 1}
SETPOINTS = {"fixed": 45, "cascade": 18, "stepped": 15, "ramped": 12, "grades": 5, "master": 5}
DRAWN = {"fam": FAMILIES, "truth": {"healthy": 55, "worn": 33, "stick": 12}, "dur_h": HOURS, "Ts": INTERVALS,
         "load": LOADS, "sp": SETPOINTS, "jitter": {"": 82, "declared": 9, "hidden": 9}}
PV_RANGES = ((0, 100), (0, 10), (0, 250), (0, 400), (0, 900), (0, 1200), (20, 30), (20, 270), (-50, 150), (-1, 5))
COLUMNS = [  # of truth.csv, in this order; further ones follow
    "name", "file", "truth", "d", "S", "J", "valve", "fric", "fam", "order", "integ", "theta", "load", "sp", "settings",
    "form", "Ts", "dur_h", "tight", "manual", "jitter", "noise_kind", "noise", "oprange", "oprange_dt", "stem_range",
    "crossings", "K", "Ti", "Td",
]
PERCENT = np.linspace(0, 100, 1001)


@dataclass(frozen=True)
class Loop:
    """One recording and all that is true of it.

    time_s: seconds from the start, (n,). sp, pv, op: engineering units, NaN where nothing was stored, (n,). mode: words
    AUTO, CAS, MAN, (n,), or None. settings: as they stand in the metadata file (empty: nobody knows them). K_ideal,
    Ti_ideal, Td_ideal: the controller in ideal form on normalised signals, seconds. truth: `COLUMNS` and more; d, S, J
    and ranges in % of OP, noise as a share of the PV span, reversals of OP by more than d (healthy: 1 %) in automatic.
    """

    name: str
    time_s: Array
    sp: Array
    pv: Array
    op: Array
    mode: npt.NDArray[np.str_] | None
    settings: Mapping[str, object]
    K_ideal: float
    Ti_ideal: float
    Td_ideal: float
    pv_range: tuple[float, float]
    op_range: tuple[float, float]
    interval_s: float
    truth: Mapping[str, Any]

    @property
    def page(self) -> str:
        """Its table of a loops file."""
        return f"[loops.{self.name}]\n" + "".join(f"{k} = {json.dumps(v)}\n" for k, v in self.settings.items())


def _pick(rng: Random, chances: Mapping[Any, float]) -> Any:
    """One of the keys, with chances as given."""
    weights = np.array(list(chances.values()), dtype=float)
    return list(chances)[int(rng.choice(len(weights), p=weights / weights.sum()))]


def _log(rng: Random, low: float, high: float) -> float:
    """Log-uniform."""
    return float(np.exp(rng.uniform(math.log(low), math.log(high))))


def _lag(signal: Array, samples: float) -> Array:
    """First-order lag of a signal that starts at rest."""
    a = math.exp(-1.0 / max(samples, 1e-3))
    return lfilter([1 - a], [1, -a], signal)  # type: ignore[no-any-return]


def _held(rng: Random, n: int, gap: float, straight: bool = False) -> Array:
    """Values that change at random times, `gap` samples apart in the mean; held, or joined by straight lines."""
    count = int(n / gap * 1.5) + 12
    at = np.r_[0.0, np.cumsum(rng.exponential(0.8 * gap, count) + 0.2 * gap)]
    values, t = np.r_[0.0, rng.normal(size=count)], np.arange(n)
    return np.interp(t, at, values) if straight else values[np.searchsorted(at, t, "right") - 1]


def disturbance(rng: Random, kind: str, n: int, ti: float, warm: int, hour: float) -> Array:
    """A load of one kind, (n,), of any size; ti: integral time, warm: start of the record, hour: all in samples."""
    t, rest = np.arange(n, dtype=float), max(n - warm, 100)
    if kind == "rw":
        return np.cumsum(rng.normal(size=n))
    if kind == "ou":
        out = _lag(rng.normal(size=n), _log(rng, 1, 50) * ti)
        return _lag(out, 0.3 * ti) if rng.random() < 0.5 else out
    if kind == "steps":
        return _held(rng, n, min(_log(rng, 6, 150) * ti, rest / 4))
    if kind == "square":
        period = min(_log(rng, 8, 100) * ti, rest / 3)
        phase = 0.3 * _held(rng, n, 3 * period) + rng.uniform(0, 6.3)
        return _lag(np.sign(np.sin(2 * np.pi * t / period + phase)), rng.uniform(0.02, 1) * ti)
    if kind == "ramps":
        return _held(rng, n, min(_log(rng, 8, 80) * ti, rest / 5), straight=True)
    if kind == "diurnal":
        small = _lag(rng.normal(size=n), 10 * ti) * math.sqrt(20 * ti)
        return np.sin(2 * np.pi * t / (24 * hour) + rng.uniform(0, 6.3)) + 0.03 * small
    if kind == "sine":  # an oscillating loop upstream: one period, phase and size drift
        period = min(_log(rng, 3, 40) * ti, rest / 4)
        phase = np.cumsum(rng.normal(size=n)) * _log(rng, 0.02, 0.3) / math.sqrt(period) + rng.uniform(0, 6.3)
        return np.sin(2 * np.pi * t / period + phase) * (1 + 0.3 * _held(rng, n, 6 * period, straight=True))
    out = np.zeros(n)
    if kind == "spikes":
        at = rng.integers(0, n, max(3, int(n / min(_log(rng, 15, 200) * ti, rest / 5))))
        out[at] = rng.normal(size=len(at))
        return _lag(out, rng.uniform(0.3, 3) * ti)
    for part in rng.choice([k for k in LOADS if k not in ("mixed", "diurnal")], 2, replace=False):
        one = disturbance(rng, str(part), n, ti, warm, hour)
        out += rng.uniform(0.4, 1) * one / (np.std(one[warm:]) + 1e-9)
    return out


def setpoint(rng: Random, kind: str, n: int, ti: float, warm: int) -> Array:
    """The motion of a setpoint, (n,), of any size; ti, warm as for `disturbance`."""
    rest = max(n - warm, 100)
    if kind in ("fixed", "master"):
        return np.zeros(n)
    if kind == "cascade":
        slow, source = _log(rng, 1.5, 15) * ti, str(rng.choice(["ou", "ou", "steps", "sine"]))
        return _lag(_lag(disturbance(rng, source, n, 4 * ti, warm, 1.0), slow), slow)
    gap = rest / rng.integers(3, 7) if kind == "grades" else min(_log(rng, 10, 200) * ti, rest / 4)
    levels = _held(rng, n, gap)
    if kind == "stepped":
        return levels
    if kind == "grades":  # the same few products again and again
        few = np.sort(rng.normal(size=int(rng.integers(2, 5))))
        levels = few[np.clip(np.searchsorted(few, levels), 0, len(few) - 1)]
    width = max(2, int(min(_log(rng, 3, 30) * ti, gap / 2)))
    return np.convolve(np.r_[np.full(width - 1, levels[0]), levels], np.full(width, 1.0 / width), "valid")


def _process(rng: Random, it: SimpleNamespace) -> None:
    """Draw the process: a ruling lag and others behind it [s], dead time [s], gain in % of PV per % of OP, its sign."""
    fam, level = it.fam, it.fam == "level"
    orders = {"flow": {1: 1, 2: 4}, "pressure": {2: 1, 3: 2}, "temperature": {3: 1, 4: 1}, "level": {1: 2, 2: 1}}
    it.order = int(_pick(rng, orders.get(fam, {1: 2, 2: 3, 3: 3, 4: 2})))
    slowest = {"flow": (5, 26), "pressure": (8, 100), "temperature": (15, 150), "level": (2, 15), "generic": (5, 100)}
    ruling = _log(rng, *slowest[fam])
    it.lags = np.maximum(ruling * np.r_[1.0, np.sort(rng.uniform(0.05, 0.7, it.order - 1))[::-1]], 0.2)
    some = rng.random()
    it.theta = {"flow": rng.uniform(0.1, 1), "pressure": rng.uniform(0, 1) * (some < 0.5),
                "temperature": rng.uniform(0.1, 0.6) * ruling, "level": rng.uniform(0, 3) * (some < 0.3),
                "generic": (some < 0.7) * _log(rng, 0.05, 1.5) * ruling}[fam]
    it.sign = -1.0 if rng.random() < {"pressure": 0.5, "level": 0.5}.get(fam, 0.15) else 1.0
    it.gain, it.integ = (0.0, it.sign / _log(rng, 80, 3000)) if level else (it.sign * _log(rng, 0.4, 2.5), 0.0)
    if level:  # the tank is the first of the lags
        it.lags = it.lags[1:] if it.order == 2 else np.array([0.3])
    it.fast = rng.uniform(-0.3, 0.4) if fam == "generic" and it.order > 1 and rng.random() < 0.2 else 0.0
    it.dt = 0.2 if (ruling < 15 and not level) or it.jitter else 0.5 if ruling < 50 else 1.0


def _valve(rng: Random, it: SimpleNamespace) -> None:
    """Draw the valve: characteristic, actuator, and what is wrong with it."""
    it.valve = str(_pick(rng, VALVES[it.truth]))
    parts = it.valve.split("+")
    it.op0 = rng.uniform(40, 60) if "split" in parts else rng.uniform(30, 70)
    it.d = it.size or _log(rng, 0.8, 8.0) if it.truth == "worn" else 0.0
    it.S = _log(rng, 1.0, 6.0) if it.truth == "stick" else 0.0
    it.J, it.fric = it.S * rng.uniform(0.1, 0.6), str(_pick(rng, {"karnopp": 7, "lugre": 3})) if it.S else ""
    wall = np.array([it.S + it.J, it.S - it.J, it.S + it.J, it.S - it.J]) / 2
    if "oneway" in parts:  # sticks when it opens, hardly when it closes
        wall = np.array([0.9 * it.S, 0.9 * it.S - it.J, 0.1 * it.S, 0.1 * it.S])
    it.friction = np.r_[{"karnopp": KARNOPP, "lugre": LUGRE}.get(it.fric, 0), wall]
    slow = _log(rng, 0.3, 3) * (1 if it.fam == "flow" else 2) * ("lag" in parts)
    it.actuator = np.array([slow, float(rng.random() < 0.5)])
    worn = int(rng.random() < 0.5) if "split" in parts else 0  # which of two valves
    grows = rng.uniform(-0.2, 0.2) if "travel" in parts else 0.0
    it.gaps = np.array([it.d * (1 - worn), it.d * worn, grows, rng.uniform(-1, 1)])
    it.split = np.array([50.0, _log(rng, 0.6, 1.7)]) if "split" in parts else np.array([1e3, 1.0])
    it.flow, it.inverse, it.linearised = PERCENT, PERCENT, False
    if "eq" in parts:
        opening = rng.uniform(20, 50) ** (PERCENT / 100 - 1)
        share = rng.uniform(0.15, 1)  # of the pressure drop that the open valve takes
        flow, i = opening / np.sqrt(share + (1 - share) * opening**2), int(it.op0 * 10)
        it.linearised = bool(rng.random() < 0.15)
        if it.linearised:  # OP is flow, the positioner's table undoes the curve
            it.flow = 100 * (flow - flow[0]) / (flow[-1] - flow[0])
            it.inverse = np.interp(PERCENT, it.flow, PERCENT)
            it.gaps[0] *= (it.inverse[i + 1] - it.inverse[i - 1]) / 0.2
        else:  # slope 1 where the loop works
            it.flow = flow * 0.2 / (flow[i + 1] - flow[i - 1])


def _controller(rng: Random, it: SimpleNamespace) -> None:
    """Tune by lambda on the half-rule lag and dead time, with spread; write the settings as control systems do."""
    level = it.fam == "level"
    lags = np.r_[0.0, np.sort(it.lags)[::-1]] if level else np.r_[np.sort(it.lags)[::-1], 0.0]
    dead, lead = it.theta + lags[1] / 2 + lags[2:].sum() + it.actuator[0] + it.dt, lags[0] + lags[1] / 2
    it.speed = dead * float(np.exp(rng.normal(math.log(3.0), 0.6))) if not level else _log(rng, 20, 300)
    it.speed = max(it.speed, _log(rng, 0.5, 3) * lead) if it.fam == "flow" else it.speed
    closed = it.speed + dead
    Ti = 4 * closed * _log(rng, 0.8, 1.6) if level else min(lead * float(np.exp(rng.normal(0, 0.25))), 4 * closed)
    Ti = max(Ti, 4.5)
    it.K = it.sign * min(1 / (abs(it.integ) * closed) if level else lead / (abs(it.gain) * closed), 12.0)
    pid = rng.random() < {"temperature": 0.5, "generic": 0.25, "pressure": 0.15}.get(it.fam, 0.0)
    Td = min(lags[1] + 0.2 * it.theta, Ti / 5) if pid else 0.0
    it.form = str(_pick(rng, {"ideal": 76, "parallel": 15, "series": 9}))
    ratio = 1 + Td / Ti if it.form == "series" else 1.0  # the knobs Ti, Td of the series form in ideal form
    it.Ti, it.Td, it.Tf = Ti * ratio, Td / ratio, _log(rng, 0.05, 0.3) * Ti if rng.random() < 0.12 else 0.0
    it.tight = bool(rng.random() < 0.1)
    margin = gain_margin(it)
    it.margin = min(rng.uniform(1.4, 2.2), margin) if it.tight else max(margin, rng.uniform(2.5, 4.0))
    it.K *= min(margin / it.margin, 6.0, 12 / abs(it.K))
    it.gap, it.inside = 0.0, 1.0
    if rng.random() < (0.15 if level else 0.02):
        it.gap, it.inside = rng.uniform(1, 4), rng.uniform(0.1, 0.4)
    low, high = it.span = tuple(map(float, PV_RANGES[int(rng.integers(len(PV_RANGES)))]))
    it.settings = str(_pick(rng, {"given": 77, "ranges": 14, "none": 9}))
    shown: dict[str, object] = {"pv_range": [low, high], "op_range": [0.0, 100.0]}
    way, scale, K = rng.random(3), 1.0, it.K / ratio
    if it.settings == "given":
        shown |= {"form": it.form} if it.form != "ideal" else {}
        if rng.random() < 0.1:
            shown["units"], scale = "engineering", 100 / (high - low)
        if it.form == "parallel":
            shown |= {"K": K * scale, "Ki": K * scale / Ti} | ({"Kd": K * scale * Td} if Td else {})
        else:
            shown |= {"PB": 100 / K} if scale == 1 and K > 0 and way[0] < 0.12 else {"K": K * scale}
            shown |= ({"reset": f"{60 / Ti:.6g} /min"} if way[1] < 0.1 else {"Ti": f"{Ti / 60:.6g} min"} if way[1] > 0.8
                      else {"Ti": Ti}) | ({"Td": Td} if Td else {})
        shown |= {"Kp": it.gain} if it.gain and scale == 1 and way[2] < 0.15 else {}
        shown |= {"Tf": it.Tf} if it.Tf or way[2] > 0.8 else {}
    it.shown = shown if it.settings != "none" else {}


def _simulate(rng: Random, it: SimpleNamespace) -> tuple[Array, Array, Array, Array, Array]:
    """Let the plant run; returns SP, PV, OP, stem [%] and what was in manual. The upsets fit a range of OP drawn."""
    warm, dt, ti = it.warm, it.dt, it.Ti / it.dt
    n = warm + int((it.dur_h + it.later_h) * 3600 / dt)
    shape = disturbance(rng, it.load, n, ti, warm, 3600 / dt)
    if np.ptp(shape[warm:]) < 1e-6 * np.ptp(shape):  # nothing happens in this record
        shape, it.load = disturbance(rng, "ou", n, ti, warm, 3600 / dt), "ou"
    it.at_input = bool(rng.random() < 0.6) or it.fam == "level"
    shape = shape - shape[0] if it.at_input else _lag(shape - shape[0], rng.uniform(0.2, 2) * ti)
    moves = setpoint(rng, it.sp, n, ti, warm)
    shape, moves = shape / np.ptp(shape), (moves - moves[0]) / (np.ptp(moves) + 1e-9)
    outer, slow = np.zeros(5), _log(rng, 6, 20) * it.speed
    if it.sp == "master":
        outer = np.array([rng.uniform(0.5, 1.5), slow, slow, _log(rng, 0.5, 2), float(rng.random() < 0.7)])
    it.forward = rng.uniform(0.4, 0.9) if it.at_input and it.sp != "master" and rng.random() < 0.08 else 0.0
    ff = -it.forward * _lag(shape, 0.2 * ti)
    zero, free = np.zeros(n), np.full(n, np.nan)
    tuning = np.array([it.K, it.Ti, it.Td, 0.1 * it.Td, it.Tf, it.gap, it.inside])
    fixed = (tuning, outer, it.lags, round(it.theta / dt), it.integ, it.gain, it.fast)

    def ranges(sp: Array, load: Array, ff: Array) -> tuple[float, float]:
        """Range of OP and of PV with a perfect valve."""
        _, y, op, _, _ = control_loop(
            dt, warm, sp, load * it.at_input, load * (not it.at_input), zero, ff, free, *fixed, PERCENT, PERCENT,
            it.actuator * [1, 0], np.zeros(4), np.array([1e3, 1.0]), np.zeros(5), 50.0, np.array([-1e9, 1e9]))
        return max(float(np.ptp(op[warm:])), 1e-3), max(float(np.ptp(y[warm:])), 1e-3)

    target = float(np.clip(np.exp(rng.normal(math.log(13), 0.65)), 2, 70))
    if it.truth != "healthy" and rng.random() < 0.7:
        target = max(target, rng.uniform(1.5, 4) * max(it.d, it.S))
    share = rng.uniform(0.3, 0.8) if moves.any() else 0.0
    op_range, pv_range = ranges(zero, shape, ff)
    size = min((1 - share) * target / op_range, 30 / pv_range)
    op_range, pv_range = ranges(moves, zero, zero) if share else (1.0, 1.0)
    sp_size = min(share * target / op_range, 40 / pv_range)
    sd = _log(rng, *{"flow": (0.03, 0.4), "temperature": (0.01, 0.1)}.get(it.fam, (0.02, 0.35)))
    kick = abs(it.K) * (1 + min(0.5 * it.Td / max(dt, 0.1 * it.Td), 5.0)) / math.sqrt(1 + 2 * it.Tf / dt)
    it.noise_kind, it.noise = str(_pick(rng, {"white": 6, "coloured": 4})), min(sd, 0.06 * target / kick) / 100
    noise = rng.normal(size=n) if it.noise_kind == "white" else _lag(rng.normal(size=n), _log(rng, 1, 8) / dt)
    noise *= 100 * it.noise / noise.std()
    it.night = bool(rng.random() < 0.1)
    if it.night:
        sun = np.sin(2 * np.pi * np.arange(n) * dt / 43200 + rng.uniform(0, 6))
        noise *= np.where(sun > 0.2, rng.uniform(0.2, 0.5), 1.0)
    manual = free.copy()
    it.manual = bool(rng.random() < 0.1 and not it.test)
    for _ in range(int(rng.integers(1, 4)) * it.manual):
        begin = int(rng.uniform(warm, n))
        manual[begin : begin + int(rng.uniform(0.01, 0.05) * (n - warm))] = it.op0 + rng.uniform(-0.3, 0.3) * target
    it.limits = np.array([0.0, 100.0])
    if rng.random() < 0.1:
        it.limits = np.clip(it.op0 + target * np.array([-rng.uniform(0.7, 3), rng.uniform(0.7, 3)]), 0, 100)
    size *= it.quiet
    shape, sp = size * shape, rng.uniform(35, 65) + sp_size * moves

    for begin, steps in it.sp_moves:
        sp[warm + begin : warm + begin + len(steps)] += steps

    def run() -> tuple[Any, ...]:
        return control_loop(  # type: ignore[no-any-return]
            dt, warm, sp, shape * it.at_input, shape * (not it.at_input), noise, size * ff, manual, *fixed,
            it.flow, it.inverse, it.actuator, it.gaps, it.split, it.friction, it.op0, it.limits)

    for begin, moves in it.test:  # the operator takes over where the controller has left OP
        begin += warm
        manual[begin : begin + len(moves)] = np.clip(run()[2][begin - 1] + moves, 0, 100)
    *signals, it.crossings = run()
    return (*signals, ~np.isnan(manual))


def manual_moves(rng: Random, it: SimpleNamespace) -> list[tuple[int, Array]]:
    """Draw an operator's tests of the valve: (first sample after the start of the record, moves of OP [%] (samples,)).

    Steps, or ramps, up and down; seldom one way only. Each is held for one to six times what the process needs, a
    level until it has moved by a few per cent. it gets the size of the steps, `step`, and their `pattern`.
    """
    it.step = _log(rng, 0.5, 6.0)
    it.pattern = str(_pick(rng, TESTS))
    settle = 1.0 / (abs(it.integ) * it.step) if it.integ else it.theta + it.lags.sum() + it.actuator[0]
    hold = max(rng.uniform(1.0, 6.0) * settle, 20.0)
    moves = {"u": 1.0, "d": -1.0, "0": 0.0}
    tests, begin = [], 3600.0
    for _ in range(int(_pick(rng, {1: 3, 2: 1}))):
        steps = [moves[c] for c in it.pattern] if it.pattern != "any" else list(rng.choice([-1, 1, -2, 2], 8) / 1.5)
        steps = [-s for s in steps] if rng.random() < 0.3 else steps
        holds = hold * rng.uniform(0.7, 1.3, len(steps) + 1)
        at, levels = np.cumsum(holds), it.step * np.r_[0.0, np.cumsum(steps)]
        t = np.arange(0.0, at[-1], it.dt)
        if rng.random() < 0.2:  # the key is held down: ramps
            edge = np.sort(np.r_[0.0, at[:-1], at[:-1] + 0.4 * holds[1:], at[-1]])
            tests.append((int(begin / it.dt), np.interp(t, edge, np.repeat(levels, 2))))
        else:
            tests.append((int(begin / it.dt), levels[np.searchsorted(at[:-1], t, "right")]))
        begin += at[-1] + rng.uniform(600, 3600)
    it.dur_h = math.ceil((begin + 600.0) / 60.0) / 60.0
    return tests


def loop(seed: int, kind: str = "", **given: Any) -> Loop:
    """Simulate the loop of a seed: everything about it is drawn from the seed alone. kind: "manual" for one whose valve
    an operator tests in manual. given: what is not drawn: truth, fam ..; size: of the dead band [%]; later_h: hours
    that it goes on; sp_moves, test: (first sample after the start of the record, moves of SP or, in manual, OP [%])."""
    rng = np.random.default_rng([1915, seed, *map(ord, kind[:1])])
    it = SimpleNamespace(**{key: _pick(rng, chances) for key, chances in DRAWN.items()})
    vars(it).update({"size": 0.0, "later_h": 0.0, "sp_moves": (), "test": [], "quiet": 1.0, **given})
    it.dur_h = max(it.dur_h, 2.0) if it.Ts == 10 else it.dur_h
    it.sp = "fixed" if it.sp == "master" and it.fam == "level" else it.sp
    for part in (_process, _valve, _controller):
        part(rng, it)
    if kind:  # an operator rather tests where little happens
        it.quiet, it.test = _log(rng, 0.03, 1.0), manual_moves(rng, it)
    it.warm = int(min(12 * it.Ti, 3600) / it.dt)
    simulated = _simulate(rng, it)
    # the historian
    grid = np.arange(0, len(simulated[0]) - it.warm, round(it.Ts / it.dt))
    at = it.warm + grid
    if it.jitter:  # one scanner stamps all loops of an export
        late = np.random.default_rng([int(it.Ts), int(it.dur_h)]).normal(0, 0.15, len(grid)).clip(-0.4, 0.4)
        at = np.maximum(at + np.rint(late * it.Ts / it.dt).astype(int), it.warm)
    sp, pv, op, stem, hand = (signal[at] for signal in simulated)
    it.pv_step = _pick(rng, {0.0: 45, 0.025: 15, 0.05: 15, 0.1: 15, 0.2: 10})
    it.op_step = _pick(rng, {0.1: 50, 0.01: 30, 0.0: 20})
    pv = np.round(pv / it.pv_step) * it.pv_step if it.pv_step else pv
    op = np.round(op / it.op_step) * it.op_step if it.op_step else op
    it.compressed = _log(rng, 100, 300) * it.noise if rng.random() < 0.05 else 0.0
    pv = exception_report(pv, it.compressed) if it.compressed else pv
    if rng.random() < 0.04:  # the transmitter was away
        begin = int(rng.uniform(0, 0.95) * len(pv))
        pv[begin : begin + int(rng.uniform(0.002, 0.02) * len(pv)) + 1] = np.nan
    mode = np.where(hand, "MAN", "CAS" if it.sp in ("cascade", "master") else "AUTO")
    # the truth in terms of OP
    auto, t = op[~hand], np.arange(np.sum(~hand))
    if it.gaps[2]:
        it.d *= float(np.mean(np.maximum(0.2, 1 + it.gaps[2] * (stem - it.op0) / 10)))
    elif it.linearised:
        it.d = it.gaps[0] / float(np.interp(auto.mean(), PERCENT[:-1], 10 * np.diff(it.inverse)))
    it.oprange, it.stem_range, it.integ_gain, it.integ = np.ptp(auto), np.ptp(stem), it.integ, bool(it.integ)
    it.oprange_dt, it.reversals = np.ptp(auto - np.polyval(np.polyfit(t, auto, 1), t)), reversals(auto, it.d or 1.0)
    it.limited = np.mean((auto <= it.limits[0]) | (auto >= it.limits[1]))
    truth = {key: getattr(value, "item", lambda value=value: value)() for key, value in vars(it).items()
             if not isinstance(value, (np.ndarray, dict, tuple, list))}
    low, scale = it.span[0], np.ptp(it.span) / 100
    return Loop(f"{it.fam[0].upper()}C{seed:05d}", (at - it.warm if it.jitter == "declared" else grid) * it.dt,
                low + sp * scale, low + pv * scale, op,
                mode if it.manual or it.test or rng.random() < 0.2 else None, it.shown, it.K, it.Ti,
                it.Td, it.span, (0.0, 100.0), it.Ts, truth)


def write(folder: str | Path, seeds: Iterable[int], per_file: int = 18, kind: str = "") -> pd.DataFrame:
    """Write wide exports f*.csv.gz, their f*.loops.toml, and truth.csv (returned); equal stamps share a file. kind: as
    of `loop`."""
    folder, groups, truths = Path(folder), defaultdict(list), []
    folder.mkdir(parents=True, exist_ok=True)

    def export(loops: list[Loop]) -> None:
        name = f"f{len({row['file'] for row in truths}):03d}"
        stamps = pd.Timestamp("2026-05-04") + pd.to_timedelta(loops[0].time_s, unit="s")
        table: dict[str, object] = {"Timestamp": stamps.strftime("%Y-%m-%d %H:%M:%S.%f").str[:-3]}
        for one in loops:
            table |= {f"{one.name}.{key}": np.round(getattr(one, key.lower()), 6) for key in ("SP", "PV", "OP")}
            table |= {f"{one.name}.MODE": one.mode} if one.mode is not None else {}
            truths.append({"name": one.name, "file": f"{name}.csv.gz", **one.truth})
        pd.DataFrame(table).to_csv(folder / f"{name}.csv.gz", index=False)
        (folder / f"{name}.loops.toml").write_text("\n".join(one.page for one in loops if one.settings))

    for one in (loop(seed, kind) for seed in seeds):
        key = (one.interval_s, one.truth["dur_h"], one.truth["jitter"] == "declared")
        groups[key].append(one)
        if len(groups[key]) == per_file:
            export(groups.pop(key))
    for loops in groups.values():
        export(loops)
    table = pd.DataFrame(truths)
    table = table[[*COLUMNS, *(key for key in table if key not in COLUMNS)]]
    table.to_csv(folder / "truth.csv", index=False)
    return table


def write_compressed(folder: str | Path, seeds: Iterable[int]) -> pd.DataFrame:
    """Write long exports f*.csv.gz of one loop each, as a historian with a swinging door has them: PV to 0.5 to 2 of
    its noise, OP to 0.1 to 0.4 %, SP on change. Loops without settings, with a mode or with holes are left out."""
    folder, truths = Path(folder), []
    folder.mkdir(parents=True, exist_ok=True)
    for one in (loop(seed) for seed in seeds):
        whole = bool(np.isfinite(one.pv).all() and np.isfinite(one.op).all())
        if not (one.settings and whole) or one.truth["compressed"] or one.truth["jitter"] or one.mode is not None:
            continue
        rng, name = np.random.default_rng(int(one.name[2:])), f"f{len(truths):03d}"
        noise = 1.4826 * np.median(np.abs(np.diff(one.pv, 2))) / 6**0.5
        kept = {"SP": np.diff(one.sp, prepend=np.nan) != 0,
                "PV": swinging_door(one.pv, rng.choice([0.5, 1, 2]) * noise),
                "OP": swinging_door(one.op, rng.choice([0.1, 0.2, 0.4]))}
        stamps = pd.Timestamp("2026-05-04") + pd.to_timedelta(one.time_s, unit="s")
        pd.concat([pd.DataFrame({"tag": f"{one.name}.{key}", "timestamp": stamps[at],
                                 "value": np.round(getattr(one, key.lower())[at], 5)}) for key, at in kept.items()]
                  ).sort_values("timestamp", kind="stable").to_csv(folder / f"{name}.csv.gz", index=False)
        (folder / f"{name}.loops.toml").write_text(one.page)
        truths.append({"name": one.name, "file": f"{name}.csv.gz", **one.truth,
                       **{f"{key}_kept": kept[key].mean() for key in ("PV", "OP")}})
    table = pd.DataFrame(truths)
    table.to_csv(folder / "truth.csv", index=False)
    return table


def judged(folder: str | Path) -> pd.DataFrame:
    """Scan what `write` wrote; the truth table with verdict, confidence, size and its interval and limit [% of OP]."""
    from backlash_cli import scan_files

    rows = []
    for file in sorted(Path(folder).glob("f*.csv.gz")):
        for report in scan_files([file], loops=str(file).replace(".csv.gz", ".loops.toml"), jobs=1).loops:
            size, test = report.cluster, report.confirmation
            low, high = size.ci95 if size else (np.nan, np.nan)
            limit = (test.limit_of_detection if test else None) or np.nan
            percent = 100 * np.array([size.d if size else np.nan, low, high, limit])
            rows.append([report.loop, str(report.verdict.value), report.confidence, *percent])
    found = pd.DataFrame(rows, columns=["name", "verdict", "confidence", "found", "low", "high", "limit"])
    table = pd.read_csv(Path(folder) / "truth.csv", keep_default_na=False).merge(found, on="name", how="left")
    return table.assign(verdict=table.verdict.fillna("missing"))


def figures(table: pd.DataFrame) -> dict[str, object]:
    """How the verdicts of a group of loops fared, one row of the tables that are printed."""
    healthy, worn = table[table.truth == "healthy"], table[table.truth == "worn"]
    called, moved = worn[worn.verdict == "backlash"], worn[worn.oprange >= 2 * worn.d]
    error, inside = (called.found / called.d - 1).abs(), (called.low <= called.d) & (called.d <= called.high)
    cleared = worn[worn.verdict == "no_backlash"]
    bands = ((0, 1), (1, 2), (2, 3), (3, 99))

    def share(group: pd.DataFrame, verdict: str) -> str:
        return f"{(group.verdict == verdict).sum()}/{len(group)}"

    sizes = {f"d {a}-{b} %": share(moved[(moved.d >= a) & (moved.d < b)], "backlash") for a, b in bands}
    return {"healthy called": share(healthy, "backlash"), **sizes, "worn cleared": share(worn, "no_backlash"),
            "limit < d": int((cleared.limit < cleared.d).sum()), "|error| median": round(error.median(), 3),
            "p90": round(error.quantile(0.9), 3), "inside": round(inside.mean(), 3),
            "stick called": share(table[table.truth == "stick"], "backlash")}


def main() -> None:
    """Simulate, scan, and print the figures by family, load, setpoint and valve, and the reliability table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("loops", type=int)
    parser.add_argument("--seed", type=int, default=0, help="first seed")
    parser.add_argument("--kind", default="", choices=["", "manual"], help="manual: an operator tests the valves")
    parser.add_argument("--compressed", action="store_true", help="a swinging door between plant and file")
    parser.add_argument("--write", help="folder that keeps the exports")
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory() as passing:
        folder = chosen.write or passing
        seeds = range(chosen.seed, chosen.seed + chosen.loops)
        write_compressed(folder, seeds) if chosen.compressed else write(folder, seeds, kind=chosen.kind)
        table = judged(folder)
    for key in (None, "fam", "load", "sp", "valve", "settings", *(["pattern"] if chosen.kind else [])):
        groups = table.groupby(key) if key else [("all", table)]
        print(pd.DataFrame({f"{name}": figures(group) for name, group in groups}).T.to_string(), "\n")
    print("Stated confidence against how often it was right (sticking valves left out)")
    said = table[table.verdict.isin(["backlash", "no_backlash"]) & (table.truth != "stick")]
    right = (said.verdict == "backlash") == (said.truth == "worn")
    stated = pd.cut(said.confidence, [0, 0.5, 0.7, 0.8, 0.9, 0.95, 1], include_lowest=True)
    print(right.groupby([said.verdict, stated], observed=True).agg(["mean", "sum", "count"]).round(3).to_string())


if __name__ == "__main__":
    main()
