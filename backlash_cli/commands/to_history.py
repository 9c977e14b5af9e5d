"""A scan into the history: each export is a night, also when several were given at once."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from ..results import ScanResult
from .terminal import say

if TYPE_CHECKING:
    from ..loaders import ReadOptions
    from ..results.history import Outcome
    from ..scan import ScanOptions

LONG = 1.5 * 86400.0  # seconds; more than this is more than one night
YEAR = 365 * 86400.0  # times below this are counted from the start of the recording, not from 1970
_STAMP = re.compile(  # a date, perhaps with a time, at the end of a file's name
    r"[ _.-]+(19|20)\d\d[-_.]?(0[1-9]|1[0-2])[-_.]?(0[1-9]|[12]\d|3[01])([ _T.-]?\d\d[-_:]?\d\d([-_:]?\d\d)?)?$"
)


def remember(result: ScanResult, history: Path, inputs: Sequence[Path], *, loops: Path | None, reading: ReadOptions,
             options: ScanOptions, jobs: int | None) -> Outcome:
    """Store a scan's nights. Several exports of the same loops, joined for the report, are stored one by one."""
    from ..history.store import History

    with History(history, create=True, say=say) as store:
        parts = _one_by_one(result, inputs, loops, reading, options, jobs) or [result]
        outcome = store.add_all([undated(part) for part in parts])
    if outcome.revised and any(r.start is not None and r.start < YEAR for r in result.loops):
        say("the export has no calendar date, and so replaced the night that was there: nights are told apart by their "
            "times")
    return outcome


def _one_by_one(result: ScanResult, inputs: Sequence[Path], loops: Path | None, reading: ReadOptions,
                options: ScanOptions, jobs: int | None) -> list[ScanResult]:
    """Return a result per export where the exports are nights of the same loops; nothing where they are not."""
    from ..api import scan
    from ..errors import BacklashError
    from ..loaders import read
    from ..loaders.sources import find_sources

    long = [r.loop for r in result.loops if r.start is not None and r.end is not None and r.end - r.start > LONG]
    if not long:
        return []
    sources = find_sources(list(inputs))
    plants, failed = [], []
    for source in sources if len(sources) > 1 else ():
        try:
            plants.append(read(source.path, loops=loops, options=reading))
        except BacklashError as error:
            failed.append(f"{source.path.name}: {error}")
    nights = Counter(record.loop for plant in plants for record in plant.records)
    if not plants or max(nights.values(), default=0) < 2:
        say(f"{', '.join(long[:3])}: the export covers more than a day and enters the history as one night; "
            "scan single days to see wear")
        return []
    for words in failed:
        say(f"this export is no night of the history: {words}")
    return [scan(plant, options, jobs=jobs) for plant in plants]


def undated(result: ScanResult) -> ScanResult:
    """Return the result with the date taken off loop names that come from dated files (FIC101_20260302_2155.csv)."""
    return replace(result, loops=tuple(replace(r, loop=_STAMP.sub("", r.loop) or r.loop) for r in result.loops))
