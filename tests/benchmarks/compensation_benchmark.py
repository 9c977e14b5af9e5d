"""Is the recommended compensator gain safe and useful? 200 random loops around the Astrom-Hagglund test batch.

For every loop a record of four hours is simulated and handed to `compensate`, which knows nothing but the record and
the controller settings: the dead band comes from the scan (or, where the scan finds none, from a valve test that is
wrong by up to 10 %), the process is fitted. The recommended gain is then tried on the true loop with other loads and
other noise. The last line is what `scan` recommends by the same rule, without any simulation.

Run: python -m tests.benchmarks.compensation_benchmark [loops] [first seed]
"""

from __future__ import annotations

import sys
import time
from collections import Counter
from dataclasses import dataclass, replace

import numpy as np

from backlash_cli.errors import LoopError
from backlash_cli.scanning import scan
from backlash_cli.simulator import Compensator, Scenario, Scheme, simulate, trace, use
from backlash_cli.simulator.compensation import compensate
from backlash_cli.simulator.limit_cycle import limit_cycle
from tests.benchmarks.batch import TI, Loop, draw_loop, recording

DRAWS = 4
DAY = 150.0 * TI


@dataclass(frozen=True)
class Outcome:
    """What came of one loop; ratios are with compensator over without."""

    loop: Loop
    source: str  # "scan" or "valve test": where `compensate` has d from; "scan alone": the scan's recommendation
    share: float  # recommended gain / true dead band, 0 when refused
    why: str = ""
    iae: float = np.nan
    lowered_in: float = np.nan  # share of the single draws
    travel: float = np.nan
    oscillates: bool = False


def trial(loop: Loop, compensator: Compensator, seed: int) -> tuple[float, float]:
    """Return IAE and valve travel of the true loop among load steps of 2 to 10 %."""
    rng = np.random.default_rng([seed, 99])
    n = 10
    times = np.sort(rng.uniform(0.02, 0.95, n)) * DAY
    sizes = rng.uniform(0.02, 0.1, n) * rng.choice([-1.0, 1.0], n)
    effects = (use("backlash", d=loop.d), use("load_step", times=times.tolist(), sizes=sizes.tolist()),
               use("measurement_noise", density=loop.noise**2))
    run = trace(Scenario(loop.controller, loop.process, DAY, 0.25, effects, compensator=compensator, seed=seed))
    return float(np.abs(run.process_output).mean()), float(np.abs(np.diff(run.valve)).sum())


def oscillates(loop: Loop, compensator: Compensator) -> bool:
    """True when the true loop, pushed once, still turns its valve after 100 integral times without noise."""
    slow = max(TI, loop.process.dead_time + sum(loop.process.lags))
    push = use("load_step", times=[0.0], sizes=[1.5 * loop.d])
    run = trace(Scenario(loop.controller, loop.process, 200.0 * slow, slow / 120.0, (use("backlash", d=loop.d), push),
                         compensator=compensator))
    valve = run.valve[run.time > 100.0 * slow]
    moves = np.diff(valve)
    turns = np.count_nonzero(np.diff(np.sign(moves[np.abs(moves) > 1e-9])))
    return bool(turns >= 6 and np.ptp(valve) > 0.05 * loop.d)


def outcomes_of(seed: int) -> list[Outcome]:
    """Simulate, advise, and try the advice on the true loop; the advice of the scan too, if it gives any."""
    rng = np.random.default_rng([seed, 7])
    loop = draw_loop(rng)
    while limit_cycle(loop.controller, loop.process, loop.d) is not None:
        loop = draw_loop(rng)  # oscillates by itself: no question of compensation
    record = simulate(recording(loop, rng, seed=seed))
    # the process gain is not in the settings of most plants
    record = replace(record, settings=replace(record.settings, Kp=None, theta=None))
    scanned = scan(record)
    alone = []
    if scanned.compensator is not None:
        alone = [tried(loop, "scan alone", Compensator(scanned.compensator.gain, Scheme.ERROR), seed)]
    source = "scan"
    try:
        try:
            study = compensate(record, report=scanned)
        except LoopError as error:
            if error.code != "no_dead_band":
                raise
            source = "valve test"
            study = compensate(record, report=scanned, dead_band=loop.d * rng.uniform(0.9, 1.1))
    except LoopError as error:
        return [Outcome(loop, source, 0.0, error.code), *alone]
    if study.recommended is None:
        return [Outcome(loop, source, 0.0, study.refusals[-1].code), *alone]
    compensator = Compensator(study.recommended, Scheme.ERROR, hysteresis=study.hysteresis)
    return [tried(loop, source, compensator, seed), *alone]


def tried(loop: Loop, source: str, compensator: Compensator, seed: int) -> Outcome:
    """Return what a compensator does to the true loop."""
    pairs = [(trial(loop, Compensator(), k), trial(loop, compensator, k)) for k in range(seed * 10, seed * 10 + DRAWS)]
    without, with_it = (np.array(side) for side in zip(*pairs, strict=True))
    iae, travel = with_it.sum(axis=0) / without.sum(axis=0)
    return Outcome(loop, source, compensator.gain / loop.d, "", float(iae),
                   float(np.mean(with_it[:, 0] < without[:, 0])), float(travel), oscillates(loop, compensator))


def report(everything: list[Outcome]) -> str:
    """Return the printed summary."""
    outcomes = [o for o in everything if o.source != "scan alone"]
    advised = [o for o in outcomes if o.share > 0.0]
    refused = Counter(o.why for o in outcomes if o.share == 0.0)
    lines = [f"{len(outcomes)} loops, dead band 1 to 8 %: gain recommended in {len(advised)}, refused in "
             f"{sum(refused.values())} ({', '.join(f'{n} {why}' for why, n in refused.most_common())})"]
    for name, group in (("all", advised), ("scan", [o for o in advised if o.source == "scan"]),
                        ("valve test", [o for o in advised if o.source != "scan"]),
                        ("PI", [o for o in advised if o.loop.controller.Td == 0.0]),
                        ("PID", [o for o in advised if o.loop.controller.Td > 0.0]),
                        ("scan alone", [o for o in everything if o.source == "scan alone"])):
        if not group:
            continue
        iae, travel, share = (np.array([getattr(o, key) for o in group]) for key in ("iae", "travel", "share"))
        single = 100 * np.mean([o.lowered_in for o in group])
        lines.append(
            f"  {name:10} n {len(group):3}  limit cycles {sum(o.oscillates for o in group)}  IAE lowered "
            f"{100 * np.mean(iae < 1):5.1f} % (single runs {single:5.1f} %)  IAE ratio median {np.median(iae):.2f} p95 "
            f"{np.percentile(iae, 95):.2f}  travel median {np.median(travel):.2f} p95 {np.percentile(travel, 95):.2f}  "
            f"gain/d median {np.median(share):.2f} largest {share.max():.2f}")
    return "\n".join(lines)


def main() -> None:
    loops = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    first = int(sys.argv[2]) if len(sys.argv) > 2 else 0
    begin = time.perf_counter()
    outcomes = [o for seed in range(first, first + loops) for o in outcomes_of(seed)]
    print(report(outcomes))
    for o in outcomes:
        if o.oscillates or o.iae >= 1.0:
            print(f"    P{o.loop.family} d {o.loop.d:.3f} noise {o.loop.noise:.4f} Td {o.loop.controller.Td:.1f} "
                  f"gain/d {o.share:.2f} IAE {o.iae:.2f} travel {o.travel:.2f} oscillates {o.oscillates} ({o.source})")
    print(f"{time.perf_counter() - begin:.0f} s")


if __name__ == "__main__":
    main()
