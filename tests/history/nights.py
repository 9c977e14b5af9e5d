"""Nights for the history tests: reports made by hand, and real ones from a walked loop cut at midnight."""

from dataclasses import replace

import numpy as np

from backlash_cli.record import LoopSettings, Note
from backlash_cli.results import Cluster, Confirmation, Estimate, LoopReport, ScanResult, Verdict
from backlash_cli.scanning import ScanOptions, scan

MARCH = 1772323200.0  # 2026-03-01 00:00 UTC
DAY = 86400.0


def made(day, d, *, loop="FIC101", verdict=Verdict.BACKLASH, error=0.05, lod=0.005, confidence=0.9, **rest):
    """A report of night `day` (0 is 2026-03-01) with dead band d, as a scan would give it."""
    start = MARCH + DAY * day
    sized = d is not None and verdict in (Verdict.BACKLASH, Verdict.SUSPECTED)
    confirmation = None
    if sized:
        confirmation = Confirmation(d, (d * (1 - 2 * error), d * (1 + 2 * error)), 0.5, 50.0, lod)
    elif lod:
        confirmation = Confirmation(0.5 * lod, (0.0, lod), 0.0, -5.0, lod)
    estimates = ()
    cluster = None
    if sized:
        cluster = Cluster(0.9 * d, (0.8 * d, d), 0.2, 10, 0.9, lod)
        estimates = tuple(Estimate(start + 3600 * i, start + 3600 * i + 600, 600.0, 0.01, 0.015, d, 1 - 2 * (i % 2),
                                   True) for i in range(10))
    return LoopReport(loop, verdict, (Note("made", "made by hand"),), confidence, start, start + DAY - 1, 86400, 1.0,
                      LoopSettings(K=0.6, Ti=28.0, Kp=1.3), 40, 12, 10, 0.25, 0.4, {}, estimates, cluster,
                      confirmation, **rest)


def result(*reports):
    return ScanResult(tuple(reports), tuple(f"{r.loop}.csv" for r in reports))


def growing(days=60, first=0.01, last=0.04, noise=0.05, seed=0, loop="FIC101", repair=None, after=0.01):
    """Reports whose dead band grows from `first` to `last`, from `after` again at day `repair`."""
    rng = np.random.default_rng(seed)
    day = np.arange(days)
    d = first + (last - first) * day / (days - 1)
    if repair is not None:
        d[repair:] = after + (last - first) * (day[repair:] - repair) / (days - 1)
    return [made(int(k), float(x * (1 + noise * rng.normal())), loop=loop, error=noise) for k, x in zip(day, d,
            strict=True)]


def cut(record, edges, loop="FIC101"):
    """Real reports of a record exported in pieces."""
    reports = []
    for first, last in zip([0, *edges], [*edges, len(record)], strict=True):
        block = record.slice(first, last)
        part = replace(block, loop=loop, start=MARCH + first * record.interval, index=block.index - first)
        reports.append(scan(part, ScanOptions(confirm=False, carry=True)))
    return reports
