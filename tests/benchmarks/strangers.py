"""Recordings of plants this project did not design for: python -m tests.benchmarks.strangers N [--seed S] [--write DIR].

A plant simulator that shares nothing with `backlash_cli`: valve, actuator, process and controller are integrated in
time as they stand in a plant, with steps of 0.2 to 1 s (friction: 2 ms), and the historian keeps what it would keep.
Percent of span everywhere inside; engineering units in what `loop` hands out.

    valve:      linear, equal percentage in a line that takes its share of the pressure drop, linearised or not, actuator
                lag, play (also of a gap that depends on the travel), split range, friction by Karnopp and by LuGre
    process:    one to four lags, dead time, integrator, a fast path beside the slow one
    controller: PI and PID, lambda tuning with spread, anti-windup, limits, feed-forward, gap control, manual stretches
    truth:      what was put in and what the valve did; `crossings` counts how often the stem crossed its whole gap

`main` scans the loops through the public functions of the program and prints how the verdicts fared, by family.
"""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd
from numba import njit
from scipy.signal import lfilter

Array = npt.NDArray[np.float64]
KARNOPP, LUGRE = 1, 2
FAMILIES = {"generic": 0.31, "flow": 0.21, "pressure": 0.21, "temperature": 0.17, "level": 0.10}
LOADS = {"rw": 14, "ou": 17, "steps": 15, "sine": 14, "ramps": 11, "diurnal": 8, "spikes": 6, "square": 5, "mixed": 12}
SETPOINTS = {"fixed": 45, "cascade": 18, "stepped": 15, "ramped": 12, "grades": 5, "master": 5}
HOURS = {1.0: 1, 2.0: 1, 3.0: 2, 4.0: 2, 6.0: 1, 8.0: 1, 12.0: 2, 24.0: 1}
INTERVALS = {1.0: 4, 2.0: 2, 5.0: 3, 10.0: 2}
UNITS = ((0, 100), (0, 10), (0, 250), (0, 400), (0, 900), (0, 1200), (20, 30), (20, 270), (-50, 150), (-1, 5), (50, 450))


@dataclass(frozen=True)
class Loop:
    """One recording and all that is true of it.

    time_s: seconds from the start, (n,). sp, pv, op: engineering units, NaN where nothing was stored, (n,). mode: words
    AUTO, CAS, MAN, (n,), or None. settings: as they stand in the metadata file (empty: nobody knows them). K_ideal,
    Ti_ideal, Td_ideal: the controller in ideal form on normalised signals, seconds. truth: see `COLUMNS` and more.
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


@njit(cache=True)
def friction_step(kind, x, v, z, p, target, lag, steps, h, up, down):  # type: ignore[no-untyped-def]
    """Move a spring-opposed valve stem by `steps` of h seconds; returns stem x, its speed v, bristles z, pressure p.

    m x'' = p - x - b x' - friction, all forces in % of the travel the spring gives. up, down: (break-away, sliding)
    friction when opening and closing. Karnopp (1985), LuGre (Canudas de Wit et al., 1995).
    """
    a, mass, viscous, still, stiffness, stribeck = 1.0 - math.exp(-h / lag), 1e-3, 0.1, 0.02, 40.0, 0.5
    for i in range(steps):
        if kind == KARNOPP and v == 0.0 and i == 0:  # it will not break away within this step
            end = target + (p - target) * math.exp(-h * steps / lag)
            if -down[0] < min(p, end) - x and max(p, end) - x < up[0]:
                return x, 0.0, z, end
        p += a * (target - p)
        net = p - x
        if kind == KARNOPP:
            if abs(v) < still:
                if -down[0] <= net <= up[0]:
                    v = 0.0
                    continue
                sign = 1.0 if net > 0 else -1.0
            else:
                sign = 1.0 if v > 0 else -1.0
            new = v + h / mass * (net - sign * (up[1] if sign > 0 else down[1]) - viscous * v)
            v = 0.0 if new * v < 0 else new
        else:
            level = up if v > 0 else down
            wall = level[1] + (level[0] - level[1]) * math.exp(-((v / stribeck) ** 2))
            bent = (z + h * v) / (1.0 + h * stiffness * abs(v) / wall)  # implicit: fast stems bend them within a step
            slip, z = (bent - z) / h, bent
            v += h / mass * (net - stiffness * z - 0.05 * slip - viscous * v)
        x += h * v
    return x, v, z, p


@njit(cache=True)
def control_loop(dt, start, sp, load_in, load_out, noise, ff, manual, tuning, outer, lags, dead, integ, gain, fast, table,
                 inverse, actuator, play, split, friction, op0, limits):  # type: ignore[no-untyped-def]
    """Run the loop once; returns SP, measured PV, OP, stem [%], and crossings of the gap after sample `start`.

    sp, load_in, load_out, noise, ff: (n,) [%], deviations except sp; manual: (n,), NaN in automatic. tuning: K, Ti, Td,
    derivative filter, PV filter [s], gap half width [%], share of K inside the gap. outer: K, Ti, lag, gain of a master
    loop on top, whose setpoint `sp` then is. lags: (m,) [s]; dead: samples; integ: gain of an integrator [1/s] or 0.
    table: flow of the valve against the stem in steps of 0.1 %; inverse: stem wanted against OP, the same. actuator:
    lag [s], 1 when play sits behind it. play: d, change of d per 10 % of travel, place of the stem in the gap at the
    start. split: OP where the second valve takes over (< 0: one valve), flow of the second to the first, its d.
    friction: kind, break-away and sliding up, the same down.
    """
    n, m = len(sp), len(lags)
    y_sp, y, op, stem = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    decay = 1.0 - np.exp(-dt / lags)
    line, at = np.zeros(dead + 1), 0
    x, level = np.zeros(m), 0.0
    K, Ti, Td, Tn, Tf, gap, inside = tuning
    a_valve = 1.0 - math.exp(-dt / actuator[0]) if actuator[0] > 0 else 1.0
    a_pv, a_d = (1.0 - math.exp(-dt / Tf) if Tf > 0 else 1.0), (1.0 - math.exp(-dt / Tn) if Tn > 0 else 1.0)
    pv0 = sp[0]
    total, filtered, slow, u = 0.0, pv0, pv0, op0
    first = inverse[int(op0 * 10)]
    lagged = first
    pos = first + play[2] * play[0] / 2
    two = split[0] >= 0
    base_a, base_b = min(first, split[0]), max(first, split[0])
    pos_a, pos_b = base_a, base_b
    v, z, p, side, crossings = 0.0, 0.0, first, 0, 0
    substeps = int(round(dt / 0.002))
    flow0 = table[int(min(max(first * 10, 0), 1000))]
    master, upper, upper_i = 0.0, 0.0, 0.0
    for k in range(n):
        true = pv0 + (level if integ != 0 else gain * (x[m - 1] + fast * (x[0] - x[m - 1]))) + load_out[k]
        measured = true + noise[k]
        wanted = sp[k]
        if outer[0] != 0:
            upper += dt / outer[2] * (outer[3] * (true - pv0) + load_in[k] * outer[4] - upper)
            e2 = (sp[k] - pv0) * 0.3 - upper
            upper_i += dt / outer[1] * e2 * outer[0]
            wanted = pv0 + outer[0] * e2 + upper_i
        filtered += a_pv * (measured - filtered)
        e = wanted - filtered
        rate = (filtered - slow) * a_d / dt if Tn > 0 else 0.0
        slow += a_d * (filtered - slow)
        share = inside if abs(e) < gap else 1.0
        if math.isnan(manual[k]):
            total += share * K * e * dt / Ti
            fixed = op0 + share * K * (e - Td * rate) + ff[k]
            u = fixed + total
            if u < limits[0] or u > limits[1]:
                u = min(max(u, limits[0]), limits[1])
                total = u - fixed
        else:
            u = manual[k]
            total = u - (op0 + share * K * (e - Td * rate) + ff[k])
        y_sp[k], y[k], op[k] = wanted, measured, u
        place = min(max(u * 10, 0.0), 999.999)
        i = int(place)
        demand = inverse[i] + (place - i) * (inverse[i + 1] - inverse[i])
        if friction[0] > 0:
            pos, v, z, p = friction_step(int(friction[0]), pos, v, z, p, demand, max(actuator[0], 0.05), substeps,
                                         dt / substeps, friction[1:3], friction[3:5])
        else:
            if actuator[1] > 0:
                lagged += a_valve * (demand - lagged)
                demand = lagged
            if two:
                half = play[0] / 2
                want_a, want_b = min(demand, split[0]), max(demand, split[0])
                pos_a = min(max(pos_a, want_a - half), want_a + half)
                half = split[2] / 2
                pos_b = min(max(pos_b, want_b - half), want_b + half)
                main, half, want = (pos_a, play[0] / 2, want_a) if play[0] > 0 else (pos_b, split[2] / 2, want_b)
                free = first + (pos_a - base_a) + split[1] * (pos_b - base_b)
            else:
                half = play[0] / 2 * max(0.2, 1.0 + play[1] * (demand - first) / 10.0)
                pos = min(max(pos, demand - half), demand + half)
                main, want, free = pos, demand, pos
            contact = 1 if main <= want - half + 1e-9 else (-1 if main >= want + half - 1e-9 else 0)
            if half > 0 and contact != 0:
                if contact == -side and k >= start:
                    crossings += 1
                side = contact
            if actuator[1] <= 0:
                lagged += a_valve * (free - lagged)
                free = lagged
            stem_now = free
        if friction[0] > 0:
            stem_now = pos
        stem[k] = stem_now
        place = min(max(stem_now * 10, 0.0), 999.999)
        i = int(place)
        line[at] = table[i] + (place - i) * (table[i + 1] - table[i]) - flow0
        at = (at + 1) % (dead + 1)
        inflow = line[at] + (0.0 if outer[0] != 0 and outer[4] != 0 else load_in[k])
        for j in range(m):
            inflow = x[j] + decay[j] * (inflow - x[j])
            x[j] = inflow
        level += dt * integ * x[m - 1]
    return y_sp, y, op, stem, crossings


def reversals(signal: Array, size: float) -> int:
    """How often a signal turned by more than `size`: a zigzag that ignores smaller turns."""
    low = high = signal[0]
    side = count = 0
    for value in signal[np.flatnonzero(np.r_[True, np.diff(signal) != 0])]:
        if value > high:
            high = value
        if value < low:
            low = value
        if side >= 0 and value < high - size:
            count, side, low = count + (side > 0), -1, value
        elif side <= 0 and value > low + size:
            count, side, high = count + (side < 0), 1, value
        if side > 0:
            low = value
        elif side < 0:
            high = value
    return count


def _pick(rng: np.random.Generator, chances: Mapping[Any, float]) -> Any:
    """One of the keys, with chances as given."""
    keys = list(chances)
    weights = np.array([chances[key] for key in keys], dtype=float)
    return keys[int(rng.choice(len(keys), p=weights / weights.sum()))]


def _log(rng: np.random.Generator, low: float, high: float) -> float:
    """Log-uniform."""
    return float(np.exp(rng.uniform(math.log(low), math.log(high))))


def _lag(signal: Array, samples: float) -> Array:
    """First-order lag of a signal that starts at rest."""
    a = math.exp(-1.0 / max(samples, 1e-3))
    return lfilter([1 - a], [1, -a], signal)  # type: ignore[no-any-return]


def _held(rng: np.random.Generator, n: int, gap: float, steps: bool = True) -> Array:
    """Values that change at random times, `gap` samples apart in the mean; held, or joined by straight lines."""
    count = int(n / gap * 1.5) + 12
    at = np.r_[0.0, np.cumsum(rng.exponential(gap, count) * 0.8 + 0.2 * gap)]
    values = np.r_[0.0, rng.normal(size=count)]
    if steps:
        return values[np.searchsorted(at, np.arange(n), side="right") - 1]
    return np.interp(np.arange(n), at, values)


def disturbance(rng: np.random.Generator, kind: str, n: int, ti: float, warm: int, hour: float) -> Array:
    """A load of one kind, (n,), of any size; ti: integral time, hour: one hour, both in samples."""
    t = np.arange(n, dtype=float)
    rest = max(n - warm, 100)
    if kind == "rw":
        out = np.cumsum(rng.normal(size=n))
    elif kind == "ou":
        out = _lag(rng.normal(size=n), _log(rng, 1, 50) * ti)
        out = _lag(out, 0.3 * ti) if rng.random() < 0.5 else out
    elif kind == "steps":
        out = _held(rng, n, min(_log(rng, 6, 150) * ti, rest / 4))
    elif kind == "square":
        period = min(_log(rng, 8, 100) * ti, rest / 3)
        out = np.sign(np.sin(2 * np.pi * (t + 0.05 * period * _held(rng, n, 3 * period)) / period + rng.uniform(0, 6)))
        out = _lag(out, rng.uniform(0.02, 1) * ti)
    elif kind == "ramps":
        out = _held(rng, n, min(_log(rng, 8, 80) * ti, rest / 5), steps=False)
    elif kind == "diurnal":
        out = np.sin(2 * np.pi * t / (24 * hour) + rng.uniform(0, 6.3)) + 0.03 * _lag(
            rng.normal(size=n), 10 * ti) * math.sqrt(20 * ti)
    elif kind == "sine":
        period = min(_log(rng, 3, 40) * ti, rest / 4)
        phase = np.cumsum(rng.normal(size=n)) * _log(rng, 0.02, 0.3) / math.sqrt(period)
        out = np.sin(2 * np.pi * t / period + phase + rng.uniform(0, 6.3))
        out = out * (1 + 0.3 * _held(rng, n, 6 * period, steps=False))
    elif kind == "spikes":
        out = np.zeros(n)
        at = rng.integers(0, n, max(3, int(n / min(_log(rng, 15, 200) * ti, rest / 5))))
        out[at] = rng.normal(size=len(at))
        out = _lag(out, rng.uniform(0.3, 3) * ti)
    else:  # mixed
        parts = rng.choice([k for k in LOADS if k not in ("mixed", "diurnal")], 2, replace=False)
        out = np.zeros(n)
        for part in parts:
            one = disturbance(rng, str(part), n, ti, warm, hour)
            out += rng.uniform(0.4, 1) * one / (np.std(one[warm:]) + 1e-9)
    return out - out[0]


def setpoint(rng: np.random.Generator, kind: str, n: int, ti: float, warm: int) -> Array:
    """The motion of a setpoint, (n,), of any size."""
    rest = max(n - warm, 100)
    if kind in ("fixed", "master"):
        return np.zeros(n)
    if kind == "cascade":
        slow = _log(rng, 1.5, 15) * ti
        return _lag(_lag(disturbance(rng, str(rng.choice(["ou", "ou", "steps", "sine"])), n, 4 * ti, warm, 1.0), slow), slow)
    gap = min(_log(rng, 10, 200) * ti, rest / 4) if kind != "grades" else rest / rng.integers(3, 7)
    grades = rng.normal(size=int(rng.integers(2, 5)))
    base = _held(rng, n, gap)
    turn = np.flatnonzero(np.diff(base) != 0) + 1
    levels = np.zeros(n)
    for i, begin in enumerate(turn):
        levels[begin:] = grades[i % len(grades)] if kind == "grades" else base[begin]
    if kind == "stepped":
        return levels
    width = max(2, int(min(_log(rng, 3, 30) * ti, gap / 2)))
    return np.convolve(np.r_[np.zeros(width - 1), levels], np.full(width, 1.0 / width), "valid")


def gain_margin(K: float, Ti: float, Td: float, lags: Array, dead: float, integ: float, gain: float, fast: float) -> float:
    """Gain margin of the linear loop: how much more gain it stands."""
    w = np.geomspace(1e-4 / (lags.sum() + dead + Ti), 30 / (lags.min() + 0.02 * dead), 3000)
    s = 1j * w
    parts = 1 / (1 + s[:, None] * lags[None, :])
    process = integ / s * parts.prod(1) if integ else gain * ((1 - fast) * parts.prod(1) + fast * parts[:, 0])
    chain = abs(K) * (1 + 1 / (Ti * s) + Td * s / (1 + 0.1 * Td * s)) * process * (1 if (integ or gain) > 0 else -1)
    phase = np.unwrap(np.angle(chain)) - w * dead
    phase -= 2 * np.pi if phase[0] > 0.2 else 0
    down = np.flatnonzero((phase[:-1] > -np.pi) & (phase[1:] <= -np.pi))
    return 1 / abs(chain[down[0]]) if len(down) else 1e3


def _characteristic(rng: np.random.Generator, valve: str, op0: float) -> tuple[Array, Array]:
    """Flow against stem and stem against OP in steps of 0.1 %; slope 1 at the working point op0."""
    x = np.linspace(0, 100, 1001)
    if "eq" not in valve.split("+"):
        return x, x
    inherent = rng.uniform(20, 50) ** (x / 100 - 1)
    share = rng.uniform(0.15, 1)  # of the pressure drop that the open valve takes
    flow = inherent / np.sqrt(share + (1 - share) * inherent**2)
    if rng.random() < 0.15:  # linearised in the controller: OP is flow
        flow = 100 * (flow - flow[0]) / (flow[-1] - flow[0])
        return flow, np.interp(x, flow, x)
    i = int(op0 * 10)
    return (flow - flow[i]) * 0.2 / (flow[i + 1] - flow[i - 1]) + op0, x


def _written(rng: np.random.Generator, form: str, K: float, Ti: float, Td: float, filtered: float, spans: tuple[float, float],
             gain: float | None) -> tuple[dict[str, object], tuple[float, float, float]]:
    """Controller settings as a control system shows them in its own form, and their ideal form (K, Ti, Td)."""
    ideal = (K, Ti, Td)
    if form == "series" and Td:
        ideal = (K * (1 + Td / Ti), Ti + Td, Td * Ti / (Td + Ti))
    shown: dict[str, object] = {"form": form} if form != "ideal" else {}
    scale = 1.0
    if rng.random() < 0.1:
        shown["units"], scale = "engineering", spans[1] / spans[0]
    if form == "parallel":
        shown |= {"K": K * scale, "Ki": K * scale / Ti} | ({"Kd": K * scale * Td} if Td else {})
    else:
        way = rng.random()
        shown |= {"PB": 100 / K} if scale == 1 and way < 0.12 and K > 0 else {"K": K * scale}
        shown |= {"reset": f"{60 / Ti:.6g} /min"} if 0.1 < way < 0.2 else {"Ti": f"{Ti / 60:.6g} min"} if way > 0.8 else {"Ti": Ti}
        shown |= {"Td": Td} if Td else {}
    if scale == 1 and gain is not None and rng.random() < 0.15:
        shown["Kp"] = gain
    if filtered or rng.random() < 0.2:
        shown["Tf"] = filtered
    return shown, ideal


def loop(seed: int) -> Loop:
    """Simulate the loop of a seed: everything about it is drawn from the seed alone."""
    rng = np.random.default_rng([1915, seed])
    pick, u, log = (lambda chances: _pick(rng, chances)), rng.uniform, (lambda low, high: _log(rng, low, high))
    fam, hours, interval = pick(FAMILIES), pick(HOURS), pick(INTERVALS)
    hours = max(hours, 2.0 if interval == 10 else 1.0)
    truth = pick({"healthy": 0.55, "worn": 0.33, "stick": 0.12})
    # the process [s]: a dominant lag and others behind it, dead time, gain in % of PV per % of OP
    order = int(pick({"flow": {1: 1, 2: 4}, "pressure": {2: 1, 3: 2}, "temperature": {3: 1, 4: 1}, "level": {1: 2, 2: 1},
                      "generic": {1: 2, 2: 3, 3: 3, 4: 2}}[fam]))
    ruling = log(*{"flow": (4, 20), "pressure": (8, 100), "temperature": (15, 150), "level": (2, 15), "generic": (5, 100)}[fam])
    lags = np.maximum(ruling * np.r_[1.0, np.sort(u(0.05, 0.7, order - 1))[::-1]], 0.2)
    dead = {"flow": u(0.1, 1), "pressure": u(0, 1) * (rng.random() < 0.5), "temperature": u(0.1, 0.6) * ruling,
            "level": u(0, 3) * (rng.random() < 0.3), "generic": pick({0: 2, 1: 5}) * log(0.05, 1.5) * ruling}[fam]
    sign = -1.0 if rng.random() < {"pressure": 0.5, "level": 0.5}.get(fam, 0.15) else 1.0
    gain, integ = sign * log(0.4, 2.5), 0.0
    if fam == "level":
        integ, gain, lags = sign / log(150, 4000), 0.0, lags * np.r_[np.full(order - 1, 1.0), 0.3 if order == 1 else 1.0]
    fast = u(-0.3, 0.4) if fam == "generic" and order > 1 and rng.random() < 0.2 else 0.0
    # the valve
    kind = {"healthy": {"ideal": 42, "eq": 22, "lag": 18, "lag+eq": 10, "split": 4, "eq+split": 0},
            "worn": {"play": 28, "play+lag": 22, "play+eq": 20, "play+eq+lag": 20, "play+travel": 6, "play+split": 4},
            "stick": {"stick": 60, "stick+eq": 30, "stick+oneway": 10}}[truth]
    valve = pick(kind)
    op0 = u(30, 70) if "split" not in valve else u(40, 60)
    d = log(0.8, 8.0) if truth == "worn" else 0.0
    S = log(1.0, 6.0) if truth == "stick" else 0.0
    J = S * u(0.1, 0.6)
    fric = pick({"karnopp": 7, "lugre": 3}) if S else ""
    actuator = np.array([log(0.3, 3) * (1 if fam == "flow" else 2) if "lag" in valve else 0.0, float(rng.random() < 0.5)])
    flow, inverse = _characteristic(rng, valve, op0)
    second = pick({0: 1, 1: 1})  # which of two valves is the worn one
    split = np.array([50.0, log(0.6, 1.7), d * second]) if "split" in valve else np.array([-1.0, 0, 0])
    play = np.array([d * (1 - second) if "split" in valve else d, u(-0.3, 0.3) if "travel" in valve else 0.0, u(-1, 1)])
    wall = np.array([(S + J) / 2, (S - J) / 2, (S + J) / 2, (S - J) / 2])
    if "oneway" in valve:
        wall = np.array([S * 0.9, S * 0.9 - J, S * 0.1, S * 0.1])
    friction = np.r_[{"karnopp": KARNOPP, "lugre": LUGRE}.get(fric, 0), wall]
    # the controller: lambda tuning on half-rule lag and dead time, with spread
    dt = 0.2 if ruling < 15 and fam != "level" else 0.5 if ruling < 50 else 1.0
    tail = np.r_[np.sort(lags)[::-1], 0.0] if fam != "level" else np.r_[0.0, np.sort(lags)[::-1]]
    theta = dead + tail[1] / 2 + tail[2:].sum() + actuator[0] + dt
    lead = tail[0] + tail[1] / 2
    pid = rng.random() < {"temperature": 0.5, "generic": 0.25, "pressure": 0.15}.get(fam, 0.0)
    speed = theta * float(np.exp(rng.normal(math.log(3.0), 0.6))) if fam != "level" else log(25, 400)
    speed = max(speed, log(0.4, 3) * lead) if fam == "flow" else speed
    Ti = min(lead * float(np.exp(rng.normal(0, 0.25))), 4 * (speed + theta)) if fam != "level" else 4 * (speed + theta) * log(0.8, 2)
    Ti = max(Ti, 3.5)
    K = lead / (abs(gain) * (speed + theta)) if fam != "level" else 1 / (abs(integ) * (speed + theta))
    K = sign * min(K, 12.0)
    Td = min(tail[1] + 0.2 * dead, Ti / 5) if pid else 0.0
    tight, filtered = bool(rng.random() < 0.1), (log(0.05, 0.3) * Ti if rng.random() < 0.12 else 0.0)
    form = str(pick({"ideal": 76, "parallel": 15, "series": 9}))
    low, high = UNITS[int(rng.integers(len(UNITS)))]
    written, (K, Ti, Td) = _written(rng, form, K, Ti, Td, filtered, (high - low, 100.0), gain or None)
    margin = gain_margin(K, Ti, Td, np.r_[lags, max(filtered, 0.01), max(actuator[0], 0.01)], dead + dt, integ, gain, fast)
    wanted = u(1.4, 2.2) if tight else max(margin, u(2.5, 4.0))
    cut = min(margin / wanted, 12 / abs(K)) if margin < 1e3 else 1.0
    K *= cut
    written = {key: value * cut if key in ("K", "Ki", "Kd") else value / cut if key == "PB" else value
               for key, value in written.items()}  # type: ignore[operator]
    gap, inside = (u(1, 4), u(0.1, 0.4)) if rng.random() < (0.15 if fam == "level" else 0.02) else (0.0, 1.0)
    # what happens to it
    load, sp_kind = pick(LOADS), pick(SETPOINTS)
    warm = int(min(12 * Ti, 3600) / dt)
    n = warm + int(hours * 3600 / dt)
    shape = disturbance(rng, load, n, Ti / dt, warm, 3600 / dt)
    at_input = bool(rng.random() < 0.6) or fam == "level"
    if not at_input:
        shape = _lag(shape, u(0.2, 2) * Ti / dt)
    if not np.ptp(shape[warm:]):  # nothing happened in this record
        shape, load = disturbance(rng, "ou", n, Ti / dt, warm, 3600 / dt), "ou"
    shape /= np.ptp(shape) + 1e-9
    moves = setpoint(rng, sp_kind, n, Ti / dt, warm)
    moves /= np.ptp(moves) + 1e-9
    outer = np.zeros(5)
    if sp_kind == "master":
        slow = log(6, 20) * (speed + theta)
        outer = np.array([u(0.5, 1.5), slow, slow, log(0.5, 2) * sign**2, float(rng.random() < 0.7)])
    forward = u(0.4, 0.9) if at_input and rng.random() < 0.08 and not outer[0] else 0.0
    ff = -forward * _lag(shape, 0.2 * Ti / dt) if forward else np.zeros(n)
    zero, none, identity = np.zeros(n), np.full(n, np.nan), np.linspace(0, 100, 1001)
    fixed = (np.array([K, Ti, Td, 0.1 * Td, filtered, gap, inside]), outer, lags, round(dead / dt), integ, gain, fast)
    quiet = (np.array([-1.0, 0, 0]), np.zeros(5), 50.0, np.array([-1e9, 1e9]))

    def pilot(sp: Array, load_in: Array, load_out: Array, ff: Array) -> tuple[float, float]:
        """Range of OP and of PV with a perfect valve."""
        _, y, op, _, _ = control_loop(dt, warm, sp, load_in, load_out, zero, ff, none, *fixed, identity, identity,
                                      np.array([actuator[0], 1.0]), np.zeros(3), *quiet)
        return float(np.ptp(op[warm:])), float(np.ptp(y[warm:]))

    target = float(np.clip(np.exp(rng.normal(math.log(13), 0.65)), 2, 70))
    if truth != "healthy" and rng.random() < 0.7:
        target = max(target, u(1.5, 4) * max(d, S))
    share = u(0.3, 0.8) if moves.any() else 0.0
    size = sp_size = 0.0
    op_range, pv_range = pilot(zero, shape * at_input, shape * (not at_input), ff)
    size = min((1 - share) * target / max(op_range, 1e-3), 30 / max(pv_range, 1e-3))
    if share:
        op_range, pv_range = pilot(moves, zero, zero, zero)
        sp_size = min(share * target / max(op_range, 1e-3), 40 / max(pv_range, 1e-3))
    noise_kind = str(pick({"white": 6, "coloured": 4}))
    noise_sd = log(*{"flow": (0.03, 0.4), "temperature": (0.01, 0.1)}.get(fam, (0.02, 0.35)))
    kick = abs(K) * (1 + 0.5 * min(Td / max(dt, 0.1 * Td), 10.0) if Td else 1.0) / math.sqrt(1 + 2 * filtered / dt)
    noise_sd = min(noise_sd, 0.08 * target / kick)
    noise = rng.normal(size=n)
    if noise_kind == "coloured":
        noise = _lag(noise, log(1.0, 8.0) / dt)
    noise *= noise_sd / noise.std()
    night = rng.random() < 0.1
    if night:
        noise *= np.where(np.sin(2 * np.pi * np.arange(n) * dt / 43200 + u(0, 6)) > 0.2, u(0.2, 0.5), 1.0)
    manual = none.copy()
    in_hand = rng.random() < 0.1
    if in_hand:
        for _ in range(int(rng.integers(1, 4))):
            begin = int(u(warm, n))
            manual[begin : begin + int(u(0.01, 0.05) * (n - warm))] = np.clip(op0 + u(-0.3, 0.3) * target, 5, 95)
    pv0 = u(35, 65)
    limits = np.array([0.0, 100.0]) if rng.random() < 0.9 else np.clip([op0 - u(0.6, 2) * target, op0 + u(0.6, 2) * target], 0, 100)
    y_sp, y, op, stem, crossings = control_loop(
        dt, warm, pv0 + sp_size * moves, size * shape * at_input, size * shape * (not at_input), noise, size * ff, manual,
        *fixed, flow, inverse, actuator, play, split, friction, op0, limits)
    # the historian
    step = round(interval / dt)
    grid = np.arange(0, n - warm, step)
    time_s, at, jitter = grid * dt, grid + warm, str(pick({"": 82, "declared": 9, "hidden": 9}))
    if jitter:  # one scanner stamps all loops of an export
        shift = np.random.default_rng([int(interval), int(hours)]).normal(0, 0.15, len(grid)).clip(-0.4, 0.4) * interval
        at = np.clip(at + np.rint(shift / dt).astype(int), warm, n - 1)
        time_s = (at - warm) * dt if jitter == "declared" else time_s
    pv_step, op_step = pick({0.0: 45, 0.025: 15, 0.05: 15, 0.1: 15, 0.2: 10}), pick({0.1: 50, 0.01: 30, 0.0: 20})
    sp_s, pv_s, op_s, stem_s, hand = (a[at] for a in (y_sp, y, op, stem, ~np.isnan(manual)))
    pv_s, op_s = (np.round(a / q) * q if q else a for a, q in ((pv_s, pv_step), (op_s, op_step)))
    compressed = log(1, 3) * noise_sd if rng.random() < 0.05 else 0.0
    if compressed:
        pv_s = _exception(pv_s, compressed)
    if rng.random() < 0.04:
        begin = int(u(0, len(pv_s) * 0.95))
        pv_s[begin : begin + int(u(0.002, 0.02) * len(pv_s)) + 1] = np.nan
    auto = op_s[~hand]
    mode = np.where(hand, "MAN", "CAS" if sp_kind in ("cascade", "master") else "AUTO") if in_hand or rng.random() < 0.2 else None
    known = pick({"given": 77, "ranges": 14, "none": 9})
    settings = {"pv_range": [float(low), float(high)], "op_range": [0.0, 100.0]} if known != "none" else {}
    if "travel" in valve:
        d *= float(np.mean(np.maximum(0.2, 1 + play[1] * (stem_s - op0) / 10)))
    elif inverse is not flow and not np.array_equal(inverse, identity):
        d /= float(np.interp(np.mean(auto), identity[:-1], np.diff(inverse) * 10))
    told = dict(
        truth=truth, d=d, S=S, J=J, valve=valve, fric=fric, fam=fam, order=order, integ=bool(integ), theta=dead, load=load,
        sp=sp_kind, settings=known, form=form, Ts=interval, dur_h=hours, tight=tight, manual=in_hand, jitter=jitter,
        noise_kind=noise_kind, noise=noise_sd / 100, oprange=float(np.ptp(auto)), oprange_dt=float(np.ptp(_straightened(auto))),
        stem_range=float(np.ptp(stem_s)), crossings=int(crossings), K=K, Ti=Ti, Td=Td, reversals=reversals(auto, d or 1.0),
        Kp=gain or integ, dt=dt, at_input=at_input, forward=forward, gap=gap, night=bool(night), compressed=compressed,
        pv_step=pv_step, op_step=op_step, margin=wanted, Tf=filtered, actuator=float(actuator[0]), fast=fast,
        linearised=not np.array_equal(inverse, identity), limited=float(np.mean((auto <= limits[0]) | (auto >= limits[1]))))
    scale = (high - low) / 100
    return Loop(f"{fam[0].upper()}C{seed:05d}", time_s, low + sp_s * scale, low + pv_s * scale, op_s, mode,
                settings | (written if known == "given" else {}), K, Ti, Td, (low, high), (0.0, 100.0), interval, told)


def _straightened(signal: Array) -> Array:
    """The signal without its straight line."""
    t = np.arange(len(signal))
    return signal - np.polyval(np.polyfit(t, signal, 1), t)


@njit(cache=True)
def _exception(signal, size):  # type: ignore[no-untyped-def]
    """What a historian keeps that stores a value only when it differs by `size` from the last one stored."""
    out = signal.copy()
    for i in range(1, len(out)):
        if abs(out[i] - out[i - 1]) < size:
            out[i] = out[i - 1]
    return out
