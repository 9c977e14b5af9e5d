"""Local wall-clock stamps to UTC, with the doubled hour of autumn told apart by the order of the rows."""

from __future__ import annotations

from datetime import datetime, timedelta
from zoneinfo import ZoneInfo

import numpy as np
from numpy.typing import NDArray

from ..record import Note
from .order import HOUR as _HOUR
from .order import NAT, SECOND

_EPOCH = datetime(1970, 1, 1)


class WallClock:
    """Stamps as the clocks of a zone show them to UTC, some rows of a file after the other."""

    def __init__(self, zone: str) -> None:
        self.zone = zone
        self._info = ZoneInfo(zone)
        self._rows = 0  # in the hour that occurs twice
        self._last: int | None = None
        self._within = False  # the last row lay in such an hour
        self._back = 0  # steps back since the rows came to lie there

    def utc(self, micros: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the next rows in UTC, (rows,); unreadable ones stay unreadable."""
        known = np.flatnonzero(micros != NAT)
        if not len(known):
            return micros
        local = micros[known]
        hours, inverse = np.unique(local // _HOUR, return_inverse=True)
        first = np.array([_offset(self._info, int(h), 0) for h in hours], np.int64)[inverse]
        second = np.array([_offset(self._info, int(h), 1) for h in hours], np.int64)[inverse]
        doubled = first != second
        out = micros.copy()
        out[known] = local - np.where(self._gone_back(local, doubled), second, first)
        return out

    def _gone_back(self, local: NDArray[np.int64], doubled: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """After the clock went back (a step of more than half an hour in the doubled hour) the second offset holds."""
        back = np.diff(local, prepend=local[0] if self._last is None else self._last) < -_HOUR // 2
        within = np.concatenate([[self._within], doubled])
        before = np.cumsum(back)
        begins = np.flatnonzero(~within[:-1] & within[1:])
        # steps back before the rows that lie in the hour now came there; less than none: there were some already
        earlier = np.concatenate([[-self._back], before[begins] - back[begins]])
        since = before - earlier[np.cumsum(~within[:-1] & within[1:])]
        self._rows += int(np.count_nonzero(doubled))
        self._last, self._within, self._back = int(local[-1]), bool(doubled[-1]), int(since[-1])
        return doubled & (since > 0)

    @property
    def notes(self) -> tuple[Note, ...]:
        """What is to be said of the rows so far."""
        if not self._rows:
            return ()
        text = f"{self._rows} rows lie in the hour that occurs twice in {self.zone}; they are taken in file order"
        return (Note("dst_repeated_hour", text),)


def _offset(info: ZoneInfo, hour: int, fold: int) -> int:
    try:
        moment = (_EPOCH + timedelta(hours=hour)).replace(tzinfo=info, fold=fold)
        return int((moment.utcoffset() or timedelta()).total_seconds() * SECOND)
    except (OverflowError, ValueError):
        return 0
