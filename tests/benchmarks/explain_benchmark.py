"""How often the workbench finds a hidden effect, on loops drawn at random and played by the project's simulator.

    python -m tests.benchmarks.explain_benchmark [--tier clean|plant] [--first 1000] [--count 60] [--kind backlash]
    python -m tests.benchmarks.explain_benchmark --driven [--first 1000] [--count 6]

Prints the share of single effects that come first, false alarms on loops with nothing hidden, pairs found whole,
precision of what was accepted, hold-out error over the error of the true model, dead band error and coverage of its
95 % interval, and the time per loop. Seeds below 1000 served to find faults; judge by others.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter, defaultdict

import numpy as np

from backlash_cli.model import explain

from .hidden_effects import draw


def main() -> None:
    """Run the benchmark and print its figures."""
    ask = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ask.add_argument("--tier", choices=("clean", "plant"), default="clean")
    ask.add_argument("--first", type=int, default=1000)
    ask.add_argument("--count", type=int, default=60)
    ask.add_argument("--kind", help="hidden effects, joined by +; none for none")
    ask.add_argument("--list", action="store_true", help="print every loop that is not right")
    ask.add_argument("--driven", action="store_true", help="loops that move by themselves, --count of each kind")
    given = ask.parse_args()
    if given.driven:
        from .driven_table import table

        table(given.first, given.count, shown=given.list)
        return
    kind = None if given.kind is None else tuple(k for k in given.kind.split("+") if k != "none")
    hits: dict[str, list[bool]] = defaultdict(list)
    pairs, alarms, ratios, seconds, errors, covered = [], [], [], [], [], []
    right = accepted = 0
    extras: Counter[str] = Counter()
    for seed in range(given.first, given.first + given.count):
        case = draw(seed, given.tier, kind)
        begun = time.process_time()
        found = explain(case.record)
        seconds.append(time.process_time() - begun)
        names = [e.effect for e in found.effects]
        accepted += len(names)
        right += sum(name in case.effects for name in names)
        extras.update(name for name in names if name not in case.effects)
        if not case.effects:
            alarms.append(bool(names))
        elif len(case.effects) == 1:
            hits[case.effects[0]].append(found.missing_effect == case.effects[0])
        else:
            pairs.append(set(case.effects) <= set(names))
        if "quantization" not in case.effects:
            ratios.append(found.rmse_holdout / case.oracle)
        for effect in found.effects:
            if effect.effect == "backlash" and "backlash" in case.effects:
                d, true = effect.parameters["d"], float(case.truth["backlash"]["d"])  # type: ignore[arg-type]
                errors.append(abs(float(d.value) / true - 1.0))  # type: ignore[arg-type]
                low, high = d.ci95  # type: ignore[misc]
                covered.append(bool(low <= true <= high))  # type: ignore[operator]
        if given.list and set(names) != set(case.effects):
            shown = "+".join(case.effects) or "none"
            print(f"  seed {seed}: {shown} -> {', '.join(names) or 'none'} {case.kind} ratio {ratios[-1:]}")
    singles = [hit for found_ in hits.values() for hit in found_]
    print(f"{given.tier}: {given.count} loops from seed {given.first}")
    _share("first effect right, singles", singles)
    _share("false alarms on none", alarms)
    _share("both effects of a pair", pairs)
    precision = right / max(accepted, 1)
    print(f"{'precision of accepted':32s} {precision:.3f} ({right} of {accepted}; extra {dict(extras)})")
    _spread("hold-out error / true model", ratios)
    _spread("dead band, relative error", errors)
    _share("dead band in its interval", covered)
    _spread("seconds per loop (processor)", seconds)
    for name, found_ in sorted(hits.items()):
        print(f"  {name:24s} {sum(found_)} of {len(found_)}")


def _share(name: str, values: list[bool]) -> None:
    said = f"{np.mean(values):.3f} ({sum(values)} of {len(values)})" if values else "-"
    print(f"{name:32s} {said}")


def _spread(name: str, values: list[float]) -> None:
    said = f"median {np.median(values):.3f}, 90 % below {np.quantile(values, 0.9):.3f}" if values else "-"
    print(f"{name:32s} {said}")


if __name__ == "__main__":
    main()
