"""How well wear is followed from records: python -m tests.benchmarks.trend_benchmark [hours per night] [loops].

Sixty nights: simulated loops whose dead band grows from 1 to 4 % of span, scanned night by night; slope, date of the
3 % limit from night 40 on, and a repair at night 30. Wear of other kinds, from made sizes: tests.benchmarks.wear.
"""

from __future__ import annotations

import sys
from collections import Counter
from dataclasses import replace

import numpy as np

from backlash_cli.history.store import night_of, night_row
from backlash_cli.history.trend import wear
from backlash_cli.record import Record
from backlash_cli.results.history import DAY, Limit, Night
from backlash_cli.scanning import ScanOptions, scan
from backlash_cli.simulator import Controller, Process, Scenario, Signal, simulate, use

LIMIT = Limit(0.03, "no_positioner", "benchmark")
START = 1772323200.0
NIGHTS = 60


def worn_night(loop: int, night: int, d: float, hours: float) -> Record:
    """Return one night of a random loop: the loop's own process and tuning, the night's own load and noise."""
    own = np.random.default_rng([11, loop])
    lag, gain = own.uniform(5.0, 40.0), own.uniform(0.8, 2.0)
    controller = Controller(K=own.uniform(0.4, 1.0) / gain, Ti=lag * own.uniform(0.8, 1.4))
    size = own.uniform(0.05, 0.12)
    rng = np.random.default_rng([12, loop, night])
    times = np.cumsum(rng.uniform(8.0, 30.0, int(hours * 3600 / (8.0 * lag)))) * lag
    times = times[times < 3600 * hours - 10]
    loads = use("load_step", times=times.tolist(), sizes=(size * rng.uniform(-1, 1, len(times))).tolist())
    record = simulate(Scenario(
        controller=controller, process=Process(gain=gain, lags=(lag, 0.3 * lag), dead_time=0.1 * lag),
        duration=3600.0 * hours, step=1.0, record_interval=1.0,
        effects=(use("backlash", d=d), loads, use("measurement_noise", density=1e-6)), setpoint=Signal(0.5),
        output=0.5 / gain, seed=1000 * loop + night, name=f"L{loop}"))
    # the valve's process gain is not what a loops file usually knows
    settings = replace(record.settings, Kp=None, theta=None)
    return replace(record, start=START + DAY * night, settings=settings)


def dead_bands(repair: int | None) -> np.ndarray:
    """Dead band of every night: from 1 to 4 %, from 1 % again after a repair."""
    grown = 0.01 + 0.03 * np.arange(NIGHTS) / (NIGHTS - 1)
    return grown if repair is None else np.where(np.arange(NIGHTS) < repair, grown, grown - grown[repair] + 0.01)


def nights_of(loop: int, hours: float, repair: int | None) -> list[Night]:
    """Scan sixty nights of one loop."""
    options = ScanOptions(carry=True)
    return [night_of(night_row(scan(worn_night(loop, k, d, hours), options)))
            for k, d in enumerate(dead_bands(repair))]


def sixty_nights(hours: float, loops: int) -> None:
    """Print slope error, date error from night 40 on, and where a repair at night 30 was found."""
    slope = 0.03 / (NIGHTS - 1)
    truth = START + DAY * (0.02 / slope) + 1800.0 * hours
    print(f"sixty nights of {hours:g} h: loop, nights with a size, slope error, worst date error from night 40 [days]")
    errors, late = [], []
    for loop in range(loops):
        nights = nights_of(loop, hours, None)
        whole = wear(f"L{loop}", nights, (), LIMIT)
        dates = [wear("", nights[:n], (), LIMIT).limit_date for n in range(40, NIGHTS + 1, 4)]
        worst = max(abs(d[0] - truth) / DAY if d else np.inf for d in dates)
        now = whole.current
        error = (now.slope / slope - 1) if now is not None and now.slope is not None else np.nan
        errors.append(error)
        late.append(worst)
        print(f"  {loop} {sum(n.d is not None for n in nights)} {error:+.3f} {worst:.1f} repairs {len(whole.repairs)} "
              f"{dict(Counter(str(n.verdict) for n in nights))}")
    print(f"  slope within 15 %: {np.mean(np.abs(errors) <= 0.15):.2f}; date within 10 days: "
          f"{np.mean(np.array(late) <= 10):.2f}")
    print("a repair at night 30, not marked: loop, night where it was found")
    for loop in range(loops):
        found = wear("", nights_of(loop, hours, 30), (), LIMIT).repairs
        print(f"  {loop} {[round((r.time - START) / DAY, 1) for r in found]}")


def main() -> None:
    """Print slopes, dates and repairs."""
    hours = float(sys.argv[1]) if len(sys.argv) > 1 else 8.0
    loops = int(sys.argv[2]) if len(sys.argv) > 2 else 4
    sixty_nights(hours, loops)


if __name__ == "__main__":
    main()
