"""How often the 95 % intervals of a model hold the true numbers, per effect, parameter and kind of record.

    python -m tests.benchmarks.interval_coverage [--tier clean|plant] [--first 1000] [--count 40] [--kind backlash]

Loops are drawn at random and played by the project's simulator; the model is fitted at its true structure, from start
values off the truth, so that the intervals are judged and not the search. Each loop is tried as recorded, with PV
rounded, with OP rounded, and with slow noise on PV. Prints for each parameter how many intervals held the truth (95 %
are promised), the median half width over the value, and the median error over the value.
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from backlash_cli.effects.fitting import Values
from backlash_cli.model.candidates import recorders
from backlash_cli.model.fit import Fit, fit
from backlash_cli.model.holdout import fitted_problem, through_rounding
from backlash_cli.model.intervals import fitted_effects, process_parameters
from backlash_cli.model.pipeline import Part, Shape, as_tuple, in_order
from backlash_cli.model.problem import Problem, problem_from_record
from backlash_cli.model.search import baseline
from backlash_cli.record import FloatArray, Record
from backlash_cli.results import FittedParameter

from .hidden_effects import BY_NAME, SINGLES, Case, draw

KINDS = ("as recorded", "PV rounded", "OP rounded", "slow noise")
# start values of the searched numbers lie this far off the truth
OFF = 0.1
Row = tuple[str, str, str]


def main() -> None:
    """Run the benchmark and print its table."""
    ask = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ask.add_argument("--tier", choices=("clean", "plant"), default="clean")
    ask.add_argument("--first", type=int, default=1000)
    ask.add_argument("--count", type=int, default=40, help="loops per effect")
    ask.add_argument("--kind", help="hidden effects, joined by +; default: each single effect in turn")
    ask.add_argument("--record", choices=KINDS, action="append", help="kinds of record; default: all")
    ask.add_argument("--list", action="store_true", help="print every interval that misses")
    given = ask.parse_args()
    hidden = [tuple(given.kind.split("+"))] if given.kind else [(name,) for name in SINGLES if name != "quantization"]
    held: dict[Row, list[bool]] = defaultdict(list)
    widths, errors = defaultdict(list), defaultdict(list)
    for names in hidden:
        for seed in range(given.first, given.first + given.count):
            case = draw(seed, given.tier, names)
            for kind in given.record or KINDS:
                for name, true, found in numbers(case, altered(case, kind, seed)):
                    row = (kind, "+".join(names), name)
                    inside, half, off = judged(true, found)
                    held[row].append(inside)
                    widths[row].append(half)
                    errors[row].append(off)
                    if given.list and not inside:
                        print(f"  seed {seed} {' '.join(row)}: {true:.6g} is not in {found.ci95}")
        for kind in given.record or KINDS:
            for row in (row for row in held if row[0] == kind and row[1] == "+".join(names)):
                share = f"{np.mean(held[row]):.2f} of {len(held[row])}"
                print(f"{given.tier} {row[0]:12s} {row[1]:22s} {row[2]:12s} {share:12s} half width "
                      f"{100 * np.median(widths[row]):6.2f} %  error {100 * np.median(errors[row]):6.2f} %", flush=True)


def altered(case: Case, kind: str, seed: int) -> Record:
    """Return the record of a case as a coarser transmitter, controller or a noisier process would give it."""
    random = np.random.default_rng([seed, 3])
    record, floor = case.record, case.noise_sd
    measurement, output = record.measurement, record.output
    assert output is not None
    if kind == "PV rounded":
        step = floor * random.uniform(1.0, 6.0)
        measurement = np.round(measurement / step) * step
    elif kind == "OP rounded":
        step = random.uniform(5e-4, 4e-3)
        output = np.round(output / step) * step
    elif kind == "slow noise":
        measurement = measurement + floor * wander(random, len(record), random.uniform(1.5, 6.0))
    return replace(record, measurement=measurement, output=output)


def wander(random: np.random.Generator, samples: int, memory: float) -> FloatArray:
    """Return first-order noise (samples,) of deviation 1 that is forgotten after `memory` samples."""
    a = float(np.exp(-1.0 / memory))
    out = random.standard_normal(samples)
    for k in range(1, samples):
        out[k] = a * out[k - 1] + np.sqrt(1.0 - a * a) * out[k]
    return out


def numbers(case: Case, record: Record) -> Iterator[tuple[str, float, FittedParameter]]:
    """Yield name, truth and interval of every number of the true structure fitted to a record."""
    if case.kind == "installed":
        return
    problem = problem_from_record(record)
    held = tuple(recorders(problem, baseline(problem), [BY_NAME["quantization"]]))
    seen = fitted_problem(problem, held)
    fitted = through_rounding(seen, held, true_fit(case, seen))
    for effect in fitted_effects(seen, fitted, held):
        truth = case.truth.get(effect.effect, {})
        for name, number in effect.parameters.items():
            if name in truth and not number.nuisance and number.ci95 is not None:
                yield from each(name, truth[name], number)
    process = process_parameters(seen, fitted)
    yield "Kp", case.extra["gain"], process["Kp"]
    yield "tau", case.lag, process["tau"]


def each(name: str, truth: float | tuple[float, ...], number: FittedParameter) -> Iterator[
        tuple[str, float, FittedParameter]]:
    """Yield a number, or each of several, with its own interval."""
    if not isinstance(truth, tuple):
        yield name, float(truth), number
    elif isinstance(number.value, tuple) and len(number.value) == len(truth) and name != "bends":
        for true, value, ci in zip(truth, number.value, number.ci95 or (), strict=True):
            yield name, true, replace(number, value=value, ci95=ci)  # type: ignore[arg-type]


def true_fit(case: Case, problem: Problem) -> Fit:
    """Return the fit of the true structure from start values that are off the truth."""
    parts = []
    for name in case.effects:
        if name == "quantization":
            continue
        effect = BY_NAME[name]
        values: Values = dict(case.truth[name])
        searched = {
            q.name: float(np.clip((1.0 + OFF) * as_tuple(values[q.name])[0], q.low, q.high))
            for q in effect.parameters
            if q.name in values and not q.many and not q.choices and not q.nuisance
            and q.name not in effect.fitting.linear and q.name not in effect.fitting.fixed
            and effect.fitting.search != "jumpy" and q.name not in effect.fitting.dear
        }
        parts.append(Part(effect, {**values, **searched}, "DV1" if effect.column else ""))
    base = baseline(problem)
    delay = 0.0 if problem.delay is None else problem.delay
    return fit(problem, Shape((1.0 - OFF) * case.lag, delay, in_order(parts)), base.noise)


def judged(true: float, number: FittedParameter) -> tuple[bool, float, float]:
    """Return whether the interval holds the truth, its half width and the error, both over the truth."""
    low, high = number.ci95  # type: ignore[misc]
    size = max(abs(true), 1e-12)
    value = float(number.value)  # type: ignore[arg-type]
    return bool(low <= true <= high), 0.5 * (high - low) / size, abs(value - true) / size  # type: ignore[operator]


if __name__ == "__main__":
    main()
