"""Loops of a plant that shares nothing with the workbench: physical friction, orders 1 to 3, a controller faster than
the historian. Written as exports with their truth, to calibrate `explain` on what it was not built with.

    python -m tests.benchmarks.hidden_strangers --out FOLDER [--count 60] [--seed 1] [--kind listed]

It imports nothing from backlash_cli. Everything is integrated at STEP s: the stem under Karnopp's or LuGre's friction,
the process as lags in a row, the controller as a PI at its own interval. The historian keeps every h s.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numba
import numpy as np
import pandas as pd

LISTED = ("play", "karnopp", "lugre", "rate", "saturation", "eqpct", "quick", "thermowell", "extra_delay", "quant",
          "exception", "sine", "load_step", "load_drift", "coloured")  # fmt: skip
UNLISTED = ("fouling", "leak", "asym", "sqrt", "senshyst", "vardelay")
PAIRS = (("play", "sine"), ("play", "extra_delay"), ("karnopp", "load_step"), ("rate", "extra_delay"),
         ("eqpct", "sine"), ("saturation", "play"), ("extra_delay", "quant"), ("saturation", "load_step"))  # fmt: skip
# friction: 0 none, 1 Karnopp, 2 LuGre; stem of mass M on a spring of 1 per span, so that forces are in spans
M, DAMPING, STILL = 0.01, 0.12, 2e-3
SIGMA0, SIGMA1, STRIBECK = 100.0, 0.6, 0.02


@numba.njit(cache=True)
def played(n, per, dt, control_every, setpoint, load, noise, p, lags, delay, tail):
    """Return PV before the recorder and OP, (n,) each; `per` steps of dt s for each stored sample.

    p: gain, K, Ti, friction, Fs, Fc, gap, opening rate, closing rate, low stop, high stop, curvature, authority,
    growth of the gain over the record, share of the delay that goes with the level, square root (0 or 1), width of
    the sensor's hysteresis, PV at OP 0.5, OP at the start.
    """
    gain, K, Ti, friction, Fs, Fc, gap, up, down, low, high, curve, authority = p[:13]
    growth, varying, root, hysteresis, level, u = p[13:19]
    ring = np.zeros(tail)
    x = v = z = 0.0
    travel = stem = u
    x = u
    integral = u
    lag_state = np.empty(len(lags))
    base = flow(0.5, curve, authority)
    q0 = flow(min(max(u, low), high), curve, authority)
    start = gain * (q0 - base)
    lag_state[:] = start
    ring[:] = start
    shown = level + start
    pv, op = np.empty(n), np.empty(n)
    place = 0
    held = u
    for k in range(n):
        for j in range(per):
            step = k * per + j
            if step % control_every == 0:
                y = level + lag_state[-1]
                if root > 0.0:
                    y = np.sqrt(max(y, 0.0))
                if shown < y - 0.5 * hysteresis:
                    shown = y - 0.5 * hysteresis
                elif shown > y + 0.5 * hysteresis:
                    shown = y + 0.5 * hysteresis
                measured = shown + noise[step // control_every]
                e = setpoint[k] - measured
                integral += K * e * dt * control_every / Ti
                integral = min(max(integral, 0.0 - K * e), 1.0 - K * e)
                held = min(max(K * e + integral, 0.0), 1.0)
                if j == 0:
                    pv[k], op[k] = measured, held
            # actuator
            move = held - travel
            travel += min(max(move, -down * dt), up * dt)
            if friction == 0.0:
                if travel - 0.5 * gap > stem:
                    stem = travel - 0.5 * gap
                elif travel + 0.5 * gap < stem:
                    stem = travel + 0.5 * gap
                x = stem
            elif friction == 1.0:
                force = travel - x
                if abs(v) < STILL:
                    if abs(force) <= Fs:
                        v = 0.0
                    else:
                        v += dt / M * (force - np.sign(force) * Fc)
                else:
                    before = v
                    v += dt / M * (force - np.sign(v) * Fc - DAMPING * v)
                    if v * before < 0.0:
                        v = 0.0
                x += dt * v
            else:
                # bent exactly over the step: by Euler's rule the bristles burst where the stem is fast, and it sticks
                g = Fc + (Fs - Fc) * np.exp(-((v / STRIBECK) ** 2))
                rate, bent = SIGMA0 * abs(v) / g, z
                z = z * np.exp(-rate * dt) - v * (np.expm1(-rate * dt) / rate if rate > 1e-9 else -dt)
                dz = (z - bent) / dt
                v += dt / M * (travel - x - SIGMA0 * z - SIGMA1 * dz - DAMPING * v)
                x += dt * v
            open_ = min(max(x, low), high)
            grown = 1.0 + growth * step / (n * per)
            into = gain * grown * (flow(open_, curve, authority) - base)
            ring[place] = into
            late = delay * (1.0 + varying * (0.5 - open_))
            back = min(int(late / dt), tail - 1)
            drive = ring[(place - back) % tail] + gain * load[k]
            place = (place + 1) % tail
            for i in range(len(lags)):
                lag_state[i] += dt / lags[i] * (drive - lag_state[i])
                drive = lag_state[i]
    return pv, op


@numba.njit(cache=True)
def flow(x, curve, authority):
    """Flow through the valve at opening x."""
    q = x if curve == 0.0 else np.expm1(curve * x) / np.expm1(curve)
    return q / np.sqrt(authority + (1.0 - authority) * q * q)


def wander(random, n, h, sd, tau):
    """A first-order random load, (n,)."""
    a = np.exp(-h / tau)
    out, x = np.empty(n), sd * random.standard_normal()
    for k, e in enumerate(random.standard_normal(n)):
        out[k] = x
        x = a * x + sd * np.sqrt(1 - a * a) * e
    return out


def drawn(seed: int, hidden: tuple[str, ...], plant: bool):
    """Return two days of one loop as tables, its settings and its truth."""
    random = np.random.default_rng([seed, plant])
    log = lambda a, b: float(np.exp(random.uniform(np.log(a), np.log(b))))  # noqa: E731
    lag = log(7, 50)
    order = int(random.integers(1, 4)) if plant else 1
    lags = [lag, lag * random.uniform(0.15, 0.35), 0.1 * lag][:order]
    h = 2.0 if lag > 20 else 1.0 if lag > 9 else 0.5
    theta = lag * random.uniform(0.1, 0.45)
    n, dt = (6000 if plant else 5400), min(h / 100.0, 0.005)
    if "lugre" in hidden:
        dt = 0.00125
    per = round(h / dt)
    control = int(random.choice([2, 4, 5]))
    gain = random.uniform(0.7, 1.6)
    truth: dict[str, dict[str, float]] = {}
    up = down = 1e9
    friction = Fs = Fc = gap = growth = varying = root = hysteresis = curve = 0.0
    low, high, authority, extra = 0.0, 1.0, 1.0, 0.0
    if "play" in hidden:
        gap = float(random.choice([0.01, 0.015, 0.02, 0.03, 0.04]))
        truth["play"] = {"d": gap}
    for name, kind in (("karnopp", 1.0), ("lugre", 2.0)):
        if name in hidden:
            friction, Fc = kind, float(random.choice([0.01, 0.015, 0.02]))
            Fs = Fc * float(random.choice([1.5, 1.75, 2.0]))
            truth[name] = {"Fs": Fs, "Fc": Fc}
    if "rate" in hidden:
        up = down = float(random.choice([0.1, 0.2, 0.4])) / lag
        truth["rate"] = {"r": up}
    if "saturation" in hidden:
        high = random.uniform(0.55, 0.66)
        truth["saturation"] = {"max": high}
    if "eqpct" in hidden:
        curve = float(np.log(random.choice([30.0, 40.0, 50.0])))
        truth["eqpct"] = {"R": float(np.exp(curve))}
        gain *= 1.4
    if "quick" in hidden:
        curve = -2.0
        truth["quick"] = {"auth": 1.0}
    if "thermowell" in hidden:
        lags = [*lags, lag * random.uniform(0.4, 0.9)]
        truth["thermowell"] = {"tau": lags[-1]}
    if "extra_delay" in hidden:
        extra = lag * random.uniform(0.25, 0.6)
        truth["extra_delay"] = {"theta": extra}
    if "fouling" in hidden:
        growth = float(random.choice([-0.4, 0.6]))
        truth["fouling"] = {"factor": 1 + growth}
    if "leak" in hidden:
        low = random.uniform(0.3, 0.4)
        truth["leak"] = {"flow": low}
    if "asym" in hidden:
        up, down = (1e9, 0.25 / lag) if random.random() < 0.5 else (0.2 / lag, 0.6 / lag)
        truth["asym"] = {"up": up, "dn": down}
    if "sqrt" in hidden:
        root = 1.0
        truth["sqrt"] = {}
    if "senshyst" in hidden:
        hysteresis = float(random.choice([0.01, 0.02]))
        truth["senshyst"] = {"w": hysteresis}
    if "vardelay" in hidden:
        varying = 1.5
        truth["vardelay"] = {"amp": varying}
    total = theta + extra
    closed = max(total, 0.25 * lag) * random.uniform(1.0, 2.0) + 0.3 * sum(lags[1:])
    K = lag / (gain * (closed + total + 0.5 * sum(lags[1:])))
    if curve > 2:
        K *= 0.5
    noise_sd = log(6e-4, 2.5e-3)
    steps = random.random() < 0.85
    u0 = random.uniform(0.4, 0.6)
    if high < 0.7:
        u0 = high - random.uniform(0.05, 0.12)
    if low > 0.2:
        u0 = low + random.uniform(0.05, 0.12)
    days = []
    for day in range(2):
        setpoint = np.zeros(n)
        at, value = 0, 0.0
        while at < n:
            stay = int(random.uniform(15, 45) * (lag + total) / h)
            setpoint[at : at + stay] = value
            at += stay
            value = gain * random.uniform(-0.12, 0.12) if steps else 0.0
        level = 0.5
        load = np.zeros(n)
        if plant:
            load += wander(random, n, h, random.uniform(0.003, 0.008), lag * log(1, 6))
        if not steps:
            load += wander(random, n, h, 0.04, 5 * lag)
        if "sine" in hidden:
            truth.setdefault("sine", {"amp": float(random.choice([0.02, 0.03])), "per": lag * random.uniform(0.8, 4)})
            t = truth["sine"]
            load += t["amp"] * np.sin(2 * np.pi * np.arange(n) * h / t["per"] + random.uniform(0, 6))
        if "load_step" in hidden:
            size = float(random.choice([-1, 1])) * random.uniform(0.03, 0.08)
            first, last = random.uniform(0.2, 0.5), random.uniform(0.6, 0.9)
            load[int(first * n) : int(last * n)] += size
            truth["load_step"] = {"size": size, "at": first, "back": last}
        if "load_drift" in hidden:
            load += 0.08 * np.arange(n) / n
            truth["load_drift"] = {"total": 0.08}
        samples = n * per // max(per // control, 1) + 2
        noise = noise_sd * random.standard_normal(samples)
        if "coloured" in hidden:
            noise = wander(random, samples, h / control, 3 * noise_sd, 0.5)
            truth["coloured"] = {"sd": 3 * noise_sd, "tc": 0.5}
        base = float(flow(0.5, curve, authority))
        start = gain * (float(flow(min(max(u0, low), high), curve, authority)) - base)
        sp = level + start + setpoint
        if root:
            sp = np.sqrt(np.maximum(sp, 0.01))
        p = np.array([gain, K, lag, friction, Fs, Fc, gap, up, down, low, high, curve, authority, growth, varying,
                      root, hysteresis, level, u0])  # fmt: skip
        tail = int(2.2 * total / dt) + 3
        pv, op = played(n, per, dt, max(per // control, 1), sp, load, noise, p, np.array(lags), total, tail)
        pv, sp, op = 100 * pv, 100 * sp, 100 * op
        if "quant" in hidden:
            q = truth.setdefault("quant", {"q": float(random.choice([0.5, 0.8, 1.0])) / 100})["q"]
            pv = np.rint(pv / (100 * q)) * 100 * q
        if "exception" in hidden:
            dev = truth.setdefault("exception", {"dev": float(random.choice([0.5, 0.8, 1.0])) / 100})["dev"]
            last = np.inf
            for k in range(n):
                if abs(pv[k] - last) > 100 * dev:
                    last = pv[k]
                pv[k] = last
        first = pd.Timestamp("2026-05-05T06:00:00") + pd.Timedelta(days=day)
        time = first + pd.to_timedelta(h * np.arange(n), unit="s")
        days.append(pd.DataFrame({
            "time": time.strftime("%Y-%m-%dT%H:%M:%S.%f").str[:-3], "L1.SP": np.round(sp, 3), "L1.PV": np.round(pv, 4),
            "L1.OP": np.round(op, 1 if plant else 2),
        }))  # fmt: skip
    settings = f'[loops.L1]\nK = {K:.4f}\nTi = "{lag:.3f} s"\nTd = 0.0\npv_range = [0, 100]\nop_range = [0, 100]\n'
    settings += "" if plant else f"theta = {theta:.3f}\n"
    return days, settings, {
        "hidden": truth, "plant": "plant" if plant else "clean", "setpoint": "steps" if steps else "loads",
        "order": order, "lags": lags, "theta": total, "noise": noise_sd, "true_model_error": noise_sd,
    }  # fmt: skip


def write(out: Path, count: int, seed: int, only: str = "") -> None:
    """Write `count` loops in turn of all kinds into a folder, with truth.json."""
    out.mkdir(parents=True, exist_ok=True)
    kinds = [("listed", (e,)) for e in LISTED] + [("unlisted", (e,)) for e in UNLISTED] + [("pair", p) for p in PAIRS]
    kinds += [("healthy", ())] * 6
    kinds = [k for k in kinds if only in ("", k[0], "+".join(k[1]))]
    order = np.random.default_rng(seed).permutation(len(kinds))
    truth = []
    for number in range(count):
        kind, hidden = kinds[order[number % len(kinds)]]
        days, settings, told = drawn(1000 * seed + number, tuple(hidden), bool(number % 2))
        names = [f"s{number:03d}_d{day}.csv.gz" for day in (1, 2)]
        for name, table in zip(names, days, strict=True):
            table.to_csv(out / name, index=False)
            (out / name.replace(".csv.gz", ".loops.toml")).write_text(settings)
        truth.append({"file": names[0], "second_day": names[1], "kind": kind, **told})
    (out / "truth.json").write_text(json.dumps(truth))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--count", type=int, default=35)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kind", default="")
    a = parser.parse_args()
    write(a.out, a.count, a.seed, a.kind)


if __name__ == "__main__":
    main()
