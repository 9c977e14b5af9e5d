"""The table of the workbench on loops that move by themselves: friction found, false friction, false load steps."""

from __future__ import annotations

import time
from collections import Counter, defaultdict

import numpy as np

from backlash_cli.model import explain

from .driven_loops import KINDS, draw

FRICTION = {"backlash", "stiction"}


def table(first: int, count: int, kinds: tuple[str, ...] = KINDS, *, shown: bool = False) -> None:
    """Explain `count` loops of each kind with friction and without, from seed `first`, and print the table."""
    tally: dict[str, Counter[str]] = defaultdict(Counter)
    others: Counter[str] = Counter()
    errors, covered, seconds = [], [], []
    for kind in kinds:
        for seed in range(first, first + count):
            for sticks in (True, False):
                case = draw(seed, kind, friction=sticks)
                begun = time.process_time()
                found = explain(case.record)
                seconds.append(time.process_time() - begun)
                names = [e.effect for e in found.effects]
                row = tally[kind]
                row["with" if sticks else "without"] += 1
                row["found" if sticks else "false"] += bool(FRICTION & set(names))
                row["first"] += sticks and found.missing_effect in FRICTION
                row["lost"] += bool(found.reasons) and sticks
                others.update(names if not sticks else ())
                if not case.steps:
                    row["calm"] += 1
                    row["steps"] += "load_step" in names
                told = ""
                for effect in found.effects:
                    if effect.effect in FRICTION and sticks:
                        d = effect.parameters["d" if effect.effect == "backlash" else "S"]
                        low, high = d.ci95  # type: ignore[misc]
                        errors.append(abs(float(d.value) / case.d - 1.0))  # type: ignore[arg-type]
                        covered.append(bool(low <= case.d <= high))  # type: ignore[operator]
                        told = f"{d.value:.4f} [{low:.4f}, {high:.4f}]"
                if shown:
                    gains = {n: round(g) for n, g in dict(found.details["gains"]).items()}
                    print(f"  {kind:9s} {seed} {case.process:9s} d {case.d:.4f} J {case.J:.4f} ({len(case.record)}): "
                          f"{gains or 'none'} {told} {seconds[-1]:.1f} s {[r.code for r in found.reasons]}", flush=True)
    print(f"loops that move by themselves: {count} of each kind with friction and {count} without, from seed {first}")
    print(f"{'kind':10s}{'friction found':>16s}{'came first':>12s}{'false friction':>16s}{'false load steps':>18s}")
    total: Counter[str] = Counter()
    for kind, row in [*tally.items(), ("all", total)]:
        if kind != "all":
            total.update(row)
        steps = f"{row['steps']} of {row['calm']}" if row["calm"] else "-"
        print(f"{kind:10s}{row['found']:>10d} of {row['with']:<3d}{row['first']:>8d}    {row['false']:>10d} of "
              f"{row['without']:<3d}{steps:>17s}")
    print(f"accepted where the valve is healthy: {dict(others)}")
    if errors:
        print(f"width of the dead band: relative error median {np.median(errors):.3f}, 90 % below "
              f"{np.quantile(errors, 0.9):.3f}; in its interval {np.mean(covered):.3f} of {len(covered)}")
    print(f"seconds per loop (processor): median {np.median(seconds):.2f}, 90 % below {np.quantile(seconds, 0.9):.2f}")
