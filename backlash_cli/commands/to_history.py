"""A scan into the history: each export is a night, also when several were given at once."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from ..results import ScanResult
from .terminal import say

if TYPE_CHECKING:
    from ..results.history import Outcome
    from .run_scan import Job

LONG = 1.5 * 86400.0  # seconds; more than this is more than one night
YEAR = 365 * 86400.0  # times below this are counted from the start of the recording, not from 1970
_STAMP = re.compile(  # a date, perhaps with a time, at the end of a file's name
    r"[ _.-]+(19|20)\d\d[-_.]?(0[1-9]|1[0-2])[-_.]?(0[1-9]|[12]\d|3[01])([ _T.-]?\d\d[-_:]?\d\d([-_:]?\d\d)?)?$"
)


def remember(result: ScanResult, history: Path, job: Job) -> Outcome:
    """Store a scan's nights. Several exports of the same loops, joined for the report, are stored one by one."""
    from ..history.store import History

    with History(history, create=True, say=say) as store:
        parts = _one_by_one(result, job) or [result]
        outcome = store.add_all([undated(part) for part in parts])
    if outcome.revised and any(r.start is not None and r.start < YEAR for r in result.loops):
        say("the export has no calendar date, and so replaced the night that was there: nights are told apart by their "
            "times")
    return outcome


def _one_by_one(result: ScanResult, job: Job) -> list[ScanResult]:
    """Return a result per export where the exports are nights of the same loops; nothing where they are not."""
    from ..errors import BacklashError
    from ..loaders.sources import find_sources

    long = [r.loop for r in result.loops if r.start is not None and r.end is not None and r.end - r.start > LONG]
    if not long:
        return []
    if max(map(len, job.files.values()), default=0) < 2:
        say(f"{', '.join(long[:3])}: the export covers more than a day and enters the history as one night; "
            "scan single days to see wear")
        return []
    found = []
    for source in find_sources(list(job.inputs)):
        try:
            found.append(job.scan([source.path]))
        except BacklashError as error:
            say(f"this export is no night of the history: {source.path.name}: {error}")
    return found


def undated(result: ScanResult) -> ScanResult:
    """Return the result with the date taken off loop names that come from dated files (FIC101_20260302_2155.csv)."""
    return replace(result, loops=tuple(replace(r, loop=_STAMP.sub("", r.loop) or r.loop) for r in result.loops))
