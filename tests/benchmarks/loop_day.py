"""What a loop and day cost, part by part: python -m tests.benchmarks.loop_day [loops] [first seed] [rebuilt].

Days of 86,400 samples at 1 s from the project's simulator, two in three without dead band, nine kinds of load and
setpoint motion. Prints CPU milliseconds on one core: half periods, quality, settings check, and the test of PV against
OP, each alone with what it needs to look at; then a scan of the record in memory without and with that test, which look
at every sample once for all. What reading the file costs is in the benchmark `speed`.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from backlash_cli.estimator.confirm import confirm
from backlash_cli.estimator.haegglund import detect_oscillation, error_scanner, estimate
from backlash_cli.estimator.identify import identify
from backlash_cli.estimator.quality import data_quality
from backlash_cli.estimator.settings_check import check_settings, follows
from backlash_cli.record import Record
from backlash_cli.scanning import ScanOptions, scan

from .random_loops import RandomLoop, draw

DAY = 86_400
PARTS = ("half periods", "quality", "settings", "PV against OP", "scan --no-confirm", "scan")


def day(seed: int) -> RandomLoop:
    """A day of one random loop; its settings are given as from metadata."""
    d = None if seed % 3 == 0 else 0.0
    loop = draw(seed, d=d, samples=DAY)
    settings = replace(loop.record.settings, source={"K": "metadata", "Ti": "metadata"})
    return replace(loop, record=replace(loop.record, settings=settings))


def half_periods(record: Record) -> object:
    """Half periods of the filtered and the plain error, estimates, oscillation."""
    scanner = error_scanner(record.settings, record.interval, every=False)
    scanner.update(record)
    assert record.settings.Ti is not None
    settings = replace(record.settings, Kp=1.5)
    return (estimate(scanner.smooth.finish(), record.interval, settings),
            detect_oscillation(scanner.plain.finish(), record.interval, record.settings.Ti))


def quality(record: Record) -> object:
    """What the recorder did to the signals, shares, gaps."""
    return data_quality(record)


def settings_check(record: Record) -> object:
    """Do the settings given make the recorded output?"""
    return follows(record, record.settings) or check_settings(record.settings, identify(record))


def confirmation(record: Record) -> object:
    """PV against OP through a dead band."""
    return confirm(record)


def quick_scan(record: Record) -> object:
    """All of it but the test of PV against OP."""
    return scan(record, ScanOptions(confirm=False))


def cost(part: Callable[[Record], object], record: Record) -> float:
    """CPU milliseconds of one call."""
    begin = time.process_time()
    part(record)
    return 1000.0 * (time.process_time() - begin)


def main(loops: int = 60, first: int = 0, rebuilt: bool = False) -> None:
    """Print the CPU time of each part over `loops` days."""
    parts = (half_periods, quality, settings_check, confirmation, quick_scan, scan)
    rows = []
    for seed in range(first, first + loops):
        loop = day(seed)
        record = replace(loop.record, output=None) if rebuilt else loop.record
        if not rows:  # compiles, or loads what was compiled
            for part in parts:
                part(record)
        rows.append((loop.d > 0, [cost(part, record) for part in parts]))
    worn = np.array([d for d, _ in rows])
    times = np.array([t for _, t in rows])
    print(f"CPU ms per loop and day of {DAY} samples   mean   healthy   worn   median   90 %   worst")
    for name, column in zip(PARTS, times.T, strict=True):
        values = [column.mean(), column[~worn].mean(), column[worn].mean(), np.median(column),
                  np.quantile(column, 0.9), column.max()]
        print(f"{name:42s}" + "".join(f"{v:8.2f}" for v in values))


if __name__ == "__main__":
    numbers = [int(a) for a in sys.argv[1:] if a.isdigit()]
    main(*numbers[:2], rebuilt="rebuilt" in sys.argv[1:])
