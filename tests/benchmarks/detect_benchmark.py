"""How well dead bands are found: python -m tests.benchmarks.detect_benchmark [loops] [first seed] [rebuilt].

Loops from the project's simulator (see random_loops). Prints specificity, sensitivity by size, the error of d, how
often the interval holds the truth, the time per loop, and how many verdicts of each stated confidence are right.
`rebuilt` hides OP. The limits in estimator/criteria.py and estimator/confirm.py were chosen on loops of the same
description from another generator, so these are fresh.
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from itertools import pairwise

import numpy as np

from backlash_cli.results import LoopReport, Verdict
from backlash_cli.scanning import scan

from .random_loops import CONTROLS, LOADS, RandomLoop, draw

EDGES = (0.0, 0.6, 0.8, 0.9, 0.95, 0.98, 1.0)


def size_of(loop: RandomLoop) -> str:
    """Return the group of the loop's dead band."""
    return "none" if loop.d == 0 else "1-2 %" if loop.d < 0.03 else "3-8 %"


def is_right(report: LoopReport, d: float) -> bool | None:
    """Whether a verdict on a valve with the dead band d is right; None for verdicts that say nothing about it."""
    if report.verdict in (Verdict.BACKLASH, Verdict.SUSPECTED):
        return d > 0.0
    if report.verdict is Verdict.NO_BACKLASH and report.cluster is not None:
        return d <= (report.cluster.limit_of_detection or 0.0)
    return None


def reliability(stated: list[tuple[float, bool]]) -> list[tuple[float, float, int, float, float]]:
    """Rows (from, to, verdicts, mean stated confidence, share that is right) of the classes of EDGES with verdicts."""
    rows = []
    for low, high in pairwise(EDGES):
        chosen = [(c, ok) for c, ok in stated if low <= c < high or c == high == 1.0]
        if chosen:
            mean, share = np.mean(np.array(chosen, float), axis=0).tolist()
            rows.append((low, high, len(chosen), mean, share))
    return rows


def main(loops: int = 400, first: int = 0, rebuilt: bool = False) -> None:
    """Scan `loops` random loops and print what was found."""
    counts: dict[tuple[str, str], list[int]] = {}
    errors, held, seconds, stated = [], [], [], []
    for seed in range(first, first + loops):
        loop = draw(seed)
        record = replace(loop.record, output=None) if rebuilt else loop.record
        begin = time.process_time()
        report = scan(record)
        seconds.append(time.process_time() - begin)
        called = report.verdict is Verdict.BACKLASH
        right = is_right(report, loop.d)
        if right is not None:
            stated.append((report.confidence, right))
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
    print("stated confidence    " + "".join(f"{h:>10}" for h in ("verdicts", "stated", "right")))
    for low, high, n, mean, share in reliability(stated):
        print(f"{low:.2f} to {high:.2f}         {n:10d}{mean:10.3f}{share:10.3f}")


if __name__ == "__main__":
    numbers = [int(a) for a in sys.argv[1:] if a.isdigit()]
    main(*numbers[:2], rebuilt="rebuilt" in sys.argv[1:])
