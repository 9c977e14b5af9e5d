"""Do parts of a record decide as all of its rows do? python -m tests.benchmarks.large_steps [loops].

First-order loops with a filter and rare, large load steps, between which a worn valve cycles: another generator than
`random_loops`, on which the light pass over a long record was not developed. Prints how many worn valves are missed and
how many healthy ones would be called by the evidence alone, for the light pass and for all rows, and the CPU time.
"""

from __future__ import annotations

import sys
import time

import numpy as np

from backlash_cli.estimator.confirm import ConfirmationScanner
from backlash_cli.estimator.criteria import EVIDENCE, EVIDENCE_PER_STEP
from backlash_cli.estimator.evidence import Evidence, weigh
from backlash_cli.estimator.light import LONG, weigh_lightly
from backlash_cli.estimator.rows import Rows
from tests.estimator.closed_loop import slow_loop


def drawn(loops: int, seed: int = 77) -> list[tuple[float, Rows]]:
    """Return (dead band, rows of the test) of those of `loops` random loops that are long enough for parts."""
    rng, found = np.random.default_rng(seed), []
    for i in range(loops):
        tau = rng.uniform(4.0, 30.0)
        Ti, K, d = tau * rng.uniform(0.6, 1.3), rng.uniform(0.3, 0.9), rng.choice([0.0, 0.0, 0.01, 0.02, 0.05])
        n, noise = int(rng.choice([6000, 12000, 20000])), 10 ** rng.uniform(-3.7, -2.8)
        record = slow_loop(n, 1000 + i, d, K, Ti, tau=tau, noise=noise)
        scanner = ConfirmationScanner(record.settings, record.interval)
        scanner.update(record)
        rows = scanner.rows()
        if isinstance(rows, Rows) and len(rows.y) >= LONG:
            found.append((float(d), rows))
    return found


def called(e: Evidence) -> bool:
    """Whether the evidence alone asks for a dead band."""
    return e.gain > max(EVIDENCE + EVIDENCE_PER_STEP * e.steps, e.half)


def main(loops: int = 500) -> None:
    """Print what the light pass and all rows miss and call."""
    chosen = drawn(loops)
    worn = sum(d > 0 for d, _ in chosen)
    for name, test in (("light pass", weigh_lightly), ("all rows", weigh)):
        test(chosen[0][1])
        begin = time.process_time()
        found = [(d, called(test(rows))) for d, rows in chosen]
        each = 1000.0 * (time.process_time() - begin) / len(chosen)
        print(f"{name}: missed {sum(d > 0 and not c for d, c in found)} of {worn} worn, called "
              f"{sum(d == 0 and c for d, c in found)} of {len(chosen) - worn} healthy, {each:.1f} ms a loop")


if __name__ == "__main__":
    main(*[int(a) for a in sys.argv[1:]])
