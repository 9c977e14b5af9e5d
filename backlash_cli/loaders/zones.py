"""Local wall-clock stamps to UTC, with the doubled hour of autumn told apart by the order of the rows."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime, timedelta
from zoneinfo import ZoneInfo

import numpy as np

from ..record import Note
from .times import NAT, SECOND, Times

_EPOCH = datetime(1970, 1, 1)
_HOUR = 3600 * SECOND


def localise(times: Times, zone: str) -> Times:
    """Return the stamps in UTC. In the hour that occurs twice the rows before the clock goes back are summer time."""
    micros = times.micros
    known = np.flatnonzero(micros != NAT)
    if not len(known):
        return times
    local = micros[known]
    info = ZoneInfo(zone)
    hours, inverse = np.unique(local // _HOUR, return_inverse=True)
    first = np.array([_offset(info, int(h), 0) for h in hours], np.int64)[inverse]
    second = np.array([_offset(info, int(h), 1) for h in hours], np.int64)[inverse]
    doubled = first != second
    offset = first.copy()
    notes = list(times.notes)
    if doubled.any():
        # after the clock went back (a step of more than half an hour in the doubled hour) the second offset holds
        back = np.concatenate([[False], np.diff(local) < -_HOUR // 2])
        group = np.cumsum(np.concatenate([[0], np.diff(doubled.astype(np.int8)) == 1]))
        before = np.cumsum(back)
        start = np.zeros(group[-1] + 1, np.int64)
        starts = np.flatnonzero(np.concatenate([[doubled[0]], np.diff(doubled.astype(np.int8)) == 1]))
        start[group[starts]] = before[starts] - back[starts]
        offset = np.where(doubled & (before - start[group] > 0), second, first)
        notes.append(
            Note(
                "dst_repeated_hour",
                f"{int(doubled.sum())} rows lie in the hour that occurs twice in {zone}; they are taken in file order",
            )
        )
    out = micros.copy()
    out[known] = local - offset
    return replace(times, micros=out, zoned=True, notes=tuple(notes))


def _offset(info: ZoneInfo, hour: int, fold: int) -> int:
    try:
        moment = (_EPOCH + timedelta(hours=hour)).replace(tzinfo=info, fold=fold)
        return int((moment.utcoffset() or timedelta()).total_seconds() * SECOND)
    except (OverflowError, ValueError):
        return 0


def utc_text(micros: int) -> str:
    """Return a stamp as readable text, for messages."""
    try:
        moment = datetime(1970, 1, 1, tzinfo=UTC) + timedelta(microseconds=int(micros))
        return moment.strftime("%Y-%m-%d %H:%M:%S")
    except OverflowError:
        return f"{micros / 1e6:.0f} s"
