"""From the samples of a loop to its report: the blocks through a LoopScanner, once or twice, then their oscillation."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace

import numpy as np

from .estimator.assumed_setpoint import like, with_constant_setpoint
from .estimator.cycle_verdict import says_of_cycles, with_oscillation
from .loop_scanner import LoopScanner, ScanOptions
from .record import Record
from .results import LoopReport

__all__ = ["PIECE", "LoopScanner", "ScanOptions", "scan", "scan_blocks"]

PIECE = 1 << 18  # samples taken at once: what is worked out in between stays small
DIAGNOSED = 1 << 20  # samples of an oscillation that are looked at, the last ones


def scan(record: Record, options: ScanOptions | None = None) -> LoopReport:
    """Analyse one loop's record and return its report."""
    return scan_blocks(lambda: pieces(record), options)


def scan_blocks(blocks: Callable[[], Iterable[Record]], options: ScanOptions | None = None) -> LoopReport:
    """Analyse one loop and return its report: LoopScanner updates, and what an oscillation looks like.

    blocks: gives the blocks of its record in time order, each time it is called, of at most PIECE samples. What an
    oscillation looks like needs the samples themselves, so a LoopScanner alone does not say it; the last DIAGNOSED
    are looked at. Where no setpoint was recorded and the output shows that it stood still, it is taken as constant.
    """
    scanner = _fed(blocks, options)
    if not scanner.has_setpoint:
        held = with_constant_setpoint(_last_samples(blocks()))
        if np.isfinite(held.setpoint).any():
            recorded, blocks = blocks, lambda: (like(held, block) for block in recorded())
            scanner = _fed(blocks, options)
    second = scanner.second_pass()
    if second is not None:
        for block in blocks():
            second.update(block)
        scanner = second
    report = scanner.finish()
    return with_oscillation(report, _last_samples(blocks())) if says_of_cycles(report) else report


def _fed(blocks: Callable[[], Iterable[Record]], options: ScanOptions | None) -> LoopScanner:
    scanner: LoopScanner | None = None
    for block in blocks():
        if scanner is None:
            scanner = LoopScanner(block.loop, block.settings, block.start, block.interval, options, keep=False)
        scanner.update(block)
    assert scanner is not None, "a record has one block at least"
    return scanner


def pieces(record: Record) -> Iterator[Record]:
    """Yield a record in blocks of at most PIECE samples."""
    if len(record) <= PIECE:
        yield record
        return
    for first in range(0, len(record), PIECE):
        yield record.slice(first, first + PIECE)


def _last_samples(blocks: Iterable[Record]) -> Record:
    """Join the last DIAGNOSED samples of a record."""
    kept = list(deque(blocks, DIAGNOSED // PIECE))
    if len(kept) == 1:
        return kept[0]
    output = None if kept[0].output is None else np.concatenate([x for b in kept if (x := b.output) is not None])
    return replace(
        kept[0], index=np.concatenate([b.index for b in kept]), setpoint=np.concatenate([b.setpoint for b in kept]),
        measurement=np.concatenate([b.measurement for b in kept]), output=output,
        state=np.concatenate([b.state for b in kept]), disturbances={},
    )
