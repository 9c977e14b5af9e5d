"""How well dead bands are found: python -m tests.benchmarks.detect_benchmark [loops] [first seed] [rebuilt].

Loops from the project's simulator (see random_loops). Prints specificity, sensitivity by size, the error of d, how
often the interval holds the truth, and the time per loop. `rebuilt` hides OP. The limits in estimator/criteria.py
and estimator/confirm.py were chosen on loops of the same description from another generator, so these are fresh.
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace

import numpy as np

from backlash_cli.results import Verdict
from backlash_cli.scan import scan

from .random_loops import CONTROLS, LOADS, RandomLoop, draw


def size_of(loop: RandomLoop) -> str:
    """Return the group of the loop's dead band."""
    return "none" if loop.d == 0 else "1-2 %" if loop.d < 0.03 else "3-8 %"


def main(loops: int = 400, first: int = 0, rebuilt: bool = False) -> None:
    """Scan `loops` random loops and print what was found."""
    counts: dict[tuple[str, str], list[int]] = {}
    errors, held, seconds = [], [], []
    for seed in range(first, first + loops):
        loop = draw(seed)
        record = replace(loop.record, output=None) if rebuilt else loop.record
        begin = time.process_time()
        report = scan(record)
        seconds.append(time.process_time() - begin)
        called = report.verdict is Verdict.BACKLASH
        moved = loop.d > 0 and loop.output_range >= 2 * loop.d
        for group in [loop.kind, "controls" if loop.kind in CONTROLS else "loads", "all", *(["moved"] * moved)]:
            tally = counts.setdefault((group, size_of(loop)), [0, 0])
            tally[0] += called
            tally[1] += 1
        if called and loop.d and report.confirmation:
            errors.append(abs(report.confirmation.d / loop.d - 1.0))
            held.append(report.confirmation.ci95[0] <= loop.d <= report.confirmation.ci95[1])
    print("called backlash      " + "".join(f"{size:>12}" for size in ("none", "1-2 %", "3-8 %")))
    for group in (*LOADS, *CONTROLS, "loads", "controls", "moved", "all"):
        row = [counts.get((group, size), [0, 0]) for size in ("none", "1-2 %", "3-8 %")]
        print(f"{group:20s} " + "".join(f"{a:6d} of {b:<3d}" for a, b in row))
    print(f"error of d: median {np.median(errors):.3f}, 90th percentile {np.quantile(errors, 0.9):.3f}; "
          f"interval holds {np.mean(held):.3f}; {1000 * np.median(seconds):.0f} ms per loop (median)")


if __name__ == "__main__":
    numbers = [int(a) for a in sys.argv[1:] if a.isdigit()]
    main(*numbers[:2], rebuilt="rebuilt" in sys.argv[1:])
