"""What is missing where a dead band is not found? python -m tests.benchmarks.oracle N [--seed S], on worn strangers.

Two oracles are told what the test has to find out from the same samples. Both know the size of the dead band:

    process known   what the process makes of any output is known, the load is not: the difference in log likelihood of
                    an autoregression with Student's errors for what the process does not explain, fitted to the record
                    with the valve as it is and as if it had no play
    load known      the spectrum of the load and its single shocks are known, the process is not: what is left of the
                    gap's answer, whitened, when any linear answer to the output may explain it, in nats

Printed is the share of loops, by size, where each brings more than NEEDED nats, beside that of the test itself.
"""

import argparse
from unittest.mock import patch

import numpy as np
import pandas as pd

from backlash_cli.estimator.confirm import confirm
from backlash_cli.estimator.criteria import CALLED
from backlash_cli.record import LoopSettings, Record
from backlash_cli.results import Confirmation

from . import strangers

NEEDED = CALLED  # nats
FREEDOM, LAGS, FAR = 4.0, 10, 5  # of Student's t; single samples, then means over 2, 4, 8 ..
PARTS = (1, 2, 4, 8)  # block lengths as parts of Ti; the mean of the two best counts, as in the test


def lagged(x, single, far):
    """Past of x (samples,): (single + far, samples), the first value held before the beginning."""
    total = np.append(0.0, np.cumsum(x - x[0]))
    at, rows, back = np.arange(len(x)), [np.append(np.zeros(i), (x - x[0])[:-i]) for i in range(1, single + 1)], single
    for width in 2 ** np.arange(1, far + 1):
        rows.append((total[np.maximum(at - back, 0)] - total[np.maximum(at - back - width, 0)]) / width)
        back += width
    return np.array(rows)


def regression(X, y):
    """Coefficients, errors, Student weights and log likelihood of y on the rows of X and one."""
    X, w = np.vstack([X, np.ones(len(y))]), np.ones(len(y))
    for first in (True, *[False] * 5):
        gram = (X * w) @ X.T
        b = np.linalg.solve(gram + np.diag(1e-9 * np.diag(gram) + 1e-12), (X * w) @ y)
        error = y - b @ X
        variance = np.mean(w * error**2)
        if first:
            variance = min(variance, (1.4 * np.median(np.abs(error))) ** 2)
        w = (FREEDOM + 1.0) / (FREEDOM + error**2 / variance)
    fit = -0.5 * len(y) * np.log(variance) - 0.5 * (FREEDOM + 1.0) * np.log1p(error**2 / variance / FREEDOM).sum()
    return b[:-1], error, w, fit


def process_known(load, answer, sizes):
    """Evidence [nats] from what the process does not explain, with the answer to the gap (samples,) taken for load."""
    found = []
    for size in sizes:
        true, wrong = (v[: len(v) // size * size].reshape(-1, size).mean(1) for v in (load, load + answer))
        if len(true) >= 60:
            found.append(regression(lagged(true, LAGS, 3), true)[3] - regression(lagged(wrong, LAGS, 3), wrong)[3])
    return np.mean(sorted(found)[-2:]) if found else 0.0


def load_known(load, answer, output):
    """Nats in the answer to the gap (samples,) that no linear answer to the output explains, whitened as the load."""
    b, error, w, _ = regression(lagged(load, LAGS, FAR), load)

    def white(x):
        return x - x[0] - b @ lagged(x, LAGS, FAR)

    _, left, _, _ = regression(np.array([white(x) for x in lagged(output, 8, 8)]), white(answer))
    return 0.5 * len(load) * np.log1p(np.sum(w * left**2) / np.sum(w * error**2))


def judged(seed):
    """One worn loop: its truth and the evidence of oracles and test [nats]; None for another valve."""
    with patch.object(strangers, "control_loop", wraps=strangers.control_loop) as simulated:
        loop = strangers.loop(seed)
    if loop.truth["truth"] != "worn":
        return None
    dt, warm, sp, _, _, _, _, _, tuning, _, *rest = simulated.call_args.args
    zero, output = np.zeros(len(sp)), strangers.control_loop(*simulated.call_args.args)[2]
    at = warm + np.arange(0, len(sp) - warm, round(loop.interval_s / dt))[: len(loop.pv)]
    gaps = rest[8]

    def answer_to(gaps):
        given = [*rest[:8], gaps, *rest[9:]]
        return strangers.control_loop(dt, warm, sp, zero, zero, zero, zero, output, tuning, np.zeros(5), *given)[1][at]

    known = np.isfinite(loop.pv)
    pv = np.interp(np.arange(len(loop.pv)), np.flatnonzero(known), loop.pv[known])
    pv = 100.0 * (pv - loop.pv_range[0]) / np.ptp(loop.pv_range)
    worn, new = answer_to(gaps), answer_to(gaps * [0, 0, 0, 1])
    load, answer = pv - worn, worn - new
    sizes = sorted({max(1, round(loop.Ti_ideal / part / loop.interval_s)) for part in PARTS})
    record = Record(loop.name, 0.0, loop.interval_s, np.arange(len(pv)), np.zeros(len(pv)), pv / 100.0, loop.op / 100.0,
                    (~known).astype(np.uint8), LoopSettings(K=loop.K_ideal, Ti=loop.Ti_ideal))
    found = confirm(record)
    test = float(found.details["evidence"]) if isinstance(found, Confirmation) else 0.0
    return {"d": loop.truth["d"], "range": loop.truth["oprange"], "load": loop.truth["load"], "test": test,
            "process known": process_known(load, answer, sizes), "load known": load_known(load, answer, output[at])}


def main() -> None:
    """Simulate, ask, and print."""
    parser = argparse.ArgumentParser()
    parser.add_argument("loops", type=int)
    parser.add_argument("--seed", type=int, default=70000)
    chosen = parser.parse_args()
    found = pd.DataFrame(filter(None, map(judged, range(chosen.seed, chosen.seed + chosen.loops))))
    found = found[(found.range >= 2 * found.d) & (found.d >= 1)]
    size = pd.cut(found.d, [1, 2, 3, 99], right=False, labels=["1-2 %", "2-3 %", "3 % and more"])
    means = ["test", "process known", "load known"]
    for key in (size, found.load):
        groups = (found[means] > NEEDED).groupby(key, observed=True)
        print(groups.mean().round(2).assign(loops=groups.size()).to_string(), "\n")


if __name__ == "__main__":
    main()
