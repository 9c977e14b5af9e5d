"""How well are settings read from the data, and how often are right ones blamed and wrong ones missed?

    python -m tests.benchmarks.settings [LOOPS] [SEED]

Random PI loops (two lags and a dead time, Ti 3 to 80 s, noise 0.05 to 0.5 %, dead band 0 to 5 %, nine kinds of load and
setpoint motion), recorded in several ways. The thresholds of settings_check and the intervals of identify rest on it.
"""

from __future__ import annotations

import sys
from collections import Counter
from dataclasses import dataclass

import numpy as np

from backlash_cli.estimator.identify import identify
from backlash_cli.estimator.settings_check import check_settings, follows
from backlash_cli.record import FloatArray, LoopSettings, Note, Record, record_from_arrays
from tests.estimator.closed_loop import Loop, run

ENVIRONMENTS = ("steps", "coloured", "cascade", "drift", "quiet", "sine", "square", "fastsp", "walk")
RECORDERS = (
    "every second",
    "OP to 0.1 %",
    "OP to 0.5 %",
    "PV by exception, 0.2 %",
    "means over Ti/4",
    "means over Ti/4, OP 0.1 %, PV 0.2 %",
    "every Ti/5",
    "every Ti/2",
)


@dataclass(frozen=True)
class Case:
    loop: Loop
    record: Record
    environment: str


def random_case(rng: np.random.Generator) -> Case:
    """One loop with its record at 1 s."""
    Ti = float(np.exp(rng.uniform(np.log(3.2), np.log(80.0))))
    delay = Ti * rng.uniform(0.1, 0.5)
    gain = rng.uniform(0.7, 2.0)
    K = rng.uniform(0.3, 0.6) * Ti / (delay + 0.5 * Ti) / gain
    noise = float(np.exp(rng.uniform(np.log(0.0005), np.log(0.005))))
    loop = Loop(K, Ti, gain=gain, lag=0.45 * Ti, delay=delay, noise=noise, dead_band=rng.choice([0, 0.01, 0.03, 0.05]))
    samples = int(np.clip(250 * Ti, 4000, 12000))
    environment = str(rng.choice(ENVIRONMENTS))
    load, setpoint = motion(rng, environment, samples, Ti)
    record = run(loop, samples, load=load, setpoint=0.5 + setpoint, seed=int(rng.integers(1 << 30)))
    return Case(loop, record, environment)


def motion(rng: np.random.Generator, environment: str, n: int, Ti: float) -> tuple[FloatArray, FloatArray]:
    """Load at the valve and setpoint, both around 0."""
    t, still = np.arange(n, dtype=np.float64), np.zeros(n)

    def coloured(sd: float, time_constant: float) -> FloatArray:
        a = np.exp(-1.0 / time_constant)
        out = np.empty(n)
        x = 0.0
        for k, w in enumerate(rng.normal(size=n).tolist()):
            x = a * x + np.sqrt(1.0 - a * a) * w
            out[k] = sd * x
        return out

    if environment == "steps":
        level = np.cumsum(rng.random(n) < 1.0 / (25.0 * Ti))
        return rng.uniform(-0.1, 0.1, level[-1] + 1)[level], still
    if environment == "coloured":
        return coloured(0.03, 5 * Ti), still
    if environment == "cascade":
        return coloured(0.01, 5 * Ti), coloured(0.03, 8 * Ti)
    if environment == "drift":
        return 0.1 * np.sin(2 * np.pi * t / (150 * Ti)), still
    if environment == "quiet":
        return coloured(0.005, 5 * Ti), still
    if environment == "sine":
        return 0.03 * np.sin(2 * np.pi * t / (12 * Ti)), still
    if environment == "square":
        return 0.03 * np.sign(np.sin(2 * np.pi * t / (25 * Ti))), still
    if environment == "fastsp":
        return still, 0.02 * np.sign(np.sin(2 * np.pi * t / (18 * Ti)))
    return np.cumsum(rng.normal(size=n)) * 0.03 / np.sqrt(10 * Ti), still


def exception(values: FloatArray, deviation: float) -> FloatArray:
    held = values.copy()
    last = held[0]
    for k, v in enumerate(values.tolist()):
        last = v if abs(v - last) > deviation else last
        held[k] = last
    return held


def recorded(case: Case, recorder: str) -> Record:
    """The record as another recorder would have kept it."""
    record, Ti = case.record, case.loop.Ti
    assert record.output is not None
    sp, pv, op = record.setpoint, record.measurement, record.output
    if "PV" in recorder:
        pv = exception(pv, 0.002)
    if "OP" in recorder:
        step = 0.005 if "0.5" in recorder else 0.001
        op = np.round(op / step) * step
    if recorder.startswith("means"):
        q = max(1, round(Ti / 4))
        n = len(sp) // q * q
        return record_from_arrays(*(x[:n].reshape(-1, q).mean(1) for x in (sp, pv, op)), interval=float(q))
    q = max(1, round(Ti / 5)) if "Ti/5" in recorder else max(1, round(Ti / 2)) if "Ti/2" in recorder else 1
    return record_from_arrays(sp[::q], pv[::q], op[::q], interval=float(q))


def mistakes(rng: np.random.Generator, K: float, Ti: float) -> dict[str, tuple[str, LoopSettings]]:
    """name -> (code that has to be among the findings, "" for none; settings)."""
    span = float(rng.choice([2.5, 16.0, 60.0, 150.0, 400.0, 900.0]))

    def given(K: float, Ti: float) -> LoopSettings:
        source = {"K": "metadata", "Ti": "metadata"}
        return LoopSettings(K=K, Ti=Ti, pv_range=(0.0, span), op_range=(0.0, 100.0), source=source)

    return {
        "right": ("", given(K, Ti)),
        "minutes": ("settings_ti_minutes", given(K, Ti / 60)),
        "proportional band": ("settings_proportional_band", given(100 / K, Ti)),
        "engineering gain": ("settings_engineering_gain", given(K * 100 / span, Ti)),
        "both band and minutes": ("settings_proportional_band", given(100 / K, Ti / 60)),
    }


def main(loops: int = 60, seed: int = 1) -> None:
    """Print 90th percentiles of the errors, coverage of the intervals, and flags raised."""
    rng = np.random.default_rng(seed)
    cases = [random_case(rng) for _ in range(loops)]
    print("recorded | K p90 | Ti p90 | K/Ti p90 | interval holds K, Ti, K/Ti | not read | K apart unsure")
    for recorder in RECORDERS:
        errors, held, refused, unsure = [], [], 0, 0
        flags: dict[str, Counter[str]] = {}
        passed: Counter[str] = Counter()
        for case in cases:
            record = recorded(case, recorder)
            found = identify(record)
            K, Ti = case.loop.K, case.loop.Ti
            for name, (code, settings) in mistakes(rng, K, Ti).items():
                quick = follows(record, settings)
                passed[name] += quick
                codes = [] if quick else [note.code for note in check_settings(settings, found)]
                right = not codes if not code else code in codes
                answer = "as it should" if right else "unchecked" if "settings_unchecked" in codes else "wrong"
                answer = "other flag" if answer == "wrong" and code and codes else answer
                flags.setdefault(name, Counter())[answer] += 1
            if isinstance(found, Note):
                refused += 1
                continue
            unsure += not found.separate
            pairs = ((found.K, K), (found.Ti, Ti), (found.ratio, K / Ti))
            errors.append([abs(value.value / truth - 1.0) for value, truth in pairs])
            held.append([value.ci95[0] <= truth <= value.ci95[1] for value, truth in pairs])
        p90 = " | ".join(f"{100 * x:.1f} %" for x in np.quantile(errors, 0.9, axis=0))
        coverage = ", ".join(f"{x:.2f}" for x in np.mean(held, axis=0))
        print(f"{recorder} | {p90} | {coverage} | {refused} of {loops} | {unsure}")
        for name, answers in flags.items():
            said = ", ".join(f"{n} {answer}" for answer, n in answers.most_common())
            print(f"    {name}: {said}; {passed[name]} by the quick look")


if __name__ == "__main__":
    main(*(int(x) for x in sys.argv[1:]))
