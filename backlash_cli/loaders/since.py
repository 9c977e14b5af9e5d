"""From when on data are looked at: `--since`, as if the export began there."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, UsageError
from ..record import Note
from .join import LoopSeries
from .selection import shown
from .series import Axis, CutAxis, EvenAxis, Series
from .times import NAT, SECOND, Times
from .zones import utc_text

_UNITS = {"s": 1, "min": 60, "h": 3600, "d": 86_400, "w": 7 * 86_400}
_AGE = re.compile(r"\s*(\d+(?:\.\d+)?)\s*(s|min|h|d|w)\s*")


def parse_since(text: str, timezone: str | None = None) -> tuple[int | None, int]:
    """Return (moment, age) in microseconds: "2026-11-01" or "2026-11-01T06:00+01:00" is a moment since 1970 UTC,
    "3d" (s, min, h, d, w) an age, back from the last stamp of the data; the moment is None then.

    timezone: of a moment without offset, UTC if None. Raises UsageError for anything else.
    """
    if age := _AGE.fullmatch(text):
        length = float(age[1]) * _UNITS[age[2]]
        if 0 < length < 1e10:
            return None, round(length * SECOND)
    else:
        try:
            moment = datetime.fromisoformat(text.strip())
            if moment.tzinfo is None:
                from zoneinfo import ZoneInfo

                moment = moment.replace(tzinfo=ZoneInfo(timezone) if timezone else UTC)
            since_1970 = moment.astimezone(UTC) - datetime(1970, 1, 1, tzinfo=UTC)
            return (since_1970.days * 86_400 + since_1970.seconds) * SECOND + since_1970.microseconds, 0
        except (ValueError, OverflowError):
            pass
    raise UsageError(f"{text!r} is no time", where="--since",
                     remedy="give a date such as 2026-11-01 or 2026-11-01T06:00, or an age such as 3d or 12h")


def is_age(since: str) -> bool:
    """Say whether `since` is counted back from the end of the data."""
    return _AGE.fullmatch(since) is not None


def moment_of(since: str, timezone: str | None, last: int | None) -> int:
    """Return the moment [microseconds since 1970 UTC] from which on data count; `last`: last stamp of the data.

    Raises UsageError when an age is given and the data have no stamps.
    """
    moment, age = parse_since(since, timezone)
    if moment is not None:
        return moment
    if last is None:
        raise UsageError("the data have no times", where=f"--since {since}", remedy="leave --since out")
    return last - age


def last_stamp(series: Iterable[Series]) -> int | None:
    """Return the last stamp [microseconds since 1970 UTC] of all series, None if there is none."""
    axes = {id(item.axis): item.axis for item in series}
    found: list[int] = []
    for axis in axes.values():
        last = axis.last()
        found += [] if last is None else [last]
        axis.forget()
    return max(found, default=None)


class Cut:
    """Takes off what lies before a moment; series that share their rows share the shorter ones too."""

    def __init__(self, moment: int, *, age: bool) -> None:
        self.moment, self.age = moment, age
        self._axes: dict[tuple[int, bool], tuple[Axis | None, slice | NDArray[np.int64]]] = {}
        self._kept: list[Axis] = []

    def loop(self, loop: LoopSeries) -> LoopSeries | None:
        """Return the loop from the moment on, None where no measurement is left.

        Of signals with rows of their own (a setpoint that is recorded when it changes) the last value before the
        moment stays, as it still holds. Raises InputError for a date where the data count from an unknown start.
        """
        measured = loop.roles.get("pv", [])
        if not self.age and any(not item.axis.absolute for item in measured):
            raise InputError("the times count from an unknown start", where=measured[0].where,
                             remedy="give --since as an age, such as 3h")
        own = {id(item.axis) for item in measured}
        roles = self._all(loop.roles, own)
        if measured and "pv" not in roles:
            return None
        return LoopSeries(loop.name, roles, self._all(loop.extra, own), loop.missing_tags)

    def _all(self, signals: Mapping[str, list[Series]], own: set[int]) -> dict[str, list[Series]]:
        out: dict[str, list[Series]] = {}
        for name, items in signals.items():
            parts = [part for item in items if (part := self._part(item, keep_one=id(item.axis) not in own))]
            if parts:
                out[name] = parts
        return out

    def _part(self, item: Series, *, keep_one: bool) -> Series | None:
        key = id(item.axis), keep_one
        if key not in self._axes:
            micros = item.axis.micros
            rows = self._rows(micros, keep_one)
            self._kept.append(item.axis)  # ids stay unique while they live
            self._axes[key] = _shorter(item.axis, rows, len(micros)), rows
            item.axis.forget()
        axis, rows = self._axes[key]
        if axis is None:
            return None
        if axis is item.axis:
            return item
        quality = None if item.quality is None else item.quality.part(rows)
        return replace(item, axis=axis, cells=item.cells.part(rows), quality=quality)

    def _rows(self, micros: NDArray[np.int64], keep_one: bool) -> slice | NDArray[np.int64]:
        before = (micros < self.moment) & (micros != NAT)
        if keep_one and before.any():
            held = np.flatnonzero(before)
            before[held[np.argmax(micros[held])]] = False
        later = np.flatnonzero(~before & (micros != NAT))
        if not len(later):
            return slice(0, 0)
        first = int(later[0])
        return np.flatnonzero(~before) if before[first:].any() else slice(first, None)


def _shorter(axis: Axis, rows: slice | NDArray[np.int64], count: int) -> Axis | None:
    """The stamps of some of `count` rows; None if there are none, the same axis if they are all."""
    if isinstance(rows, slice):
        first = int(rows.start or 0)
        if first == 0:
            return axis if rows.stop is None else None
        line = axis.first_line + first if axis.first_line else 0
        if isinstance(axis, EvenAxis):
            return EvenAxis(axis.start + first * axis.step, axis.step, count - first, axis.zoned, axis.where, line,
                            axis.absolute, axis.notes)
        return CutAxis(axis, first, line)
    if not len(rows):
        return None
    return axis if len(rows) == count else Axis(
        Times(axis.micros[rows], axis.absolute, axis.zoned, axis.notes), axis.where, axis.first_line)


def cut_loops(
    loops: Mapping[str, LoopSeries], moment: int, *, age: bool
) -> tuple[dict[str, LoopSeries], list[str], dict[str, InputError]]:
    """Return the loops from `moment` on, the names of those that have nothing left, and what cannot be cut."""
    cut = Cut(moment, age=age)
    kept: dict[str, LoopSeries] = {}
    without: list[str] = []
    wrong: dict[str, InputError] = {}
    for name, own in loops.items():
        try:
            shorter = cut.loop(own)
        except InputError as error:
            wrong[name] = error
            continue
        if shorter is None:
            without.append(name)
        else:
            kept[name] = shorter
    return kept, without, wrong


def since_notes(since: str, moment: int, without: Sequence[str], loops: int) -> list[Note]:
    """Say from when on data were used, and which loops have none since then."""
    when = f"{utc_text(moment)} UTC"
    notes = [Note("since", f"data before {when} were left out (--since {since})", {"since": when})]
    if without:
        without = sorted(without)
        text = f"{len(without)} of {loops} loops have no data since {when} and were not computed: {shown(without)}"
        notes.append(Note("nothing_since", text, {"loops": float(len(without)), "names": ", ".join(without)}))
    return notes


def nothing_since(since: str, moment: int, last: int | None) -> InputError:
    """The error when no loop has data since then."""
    ends = "" if last is None else f"; the data end at {utc_text(last)} UTC"
    return InputError(f"no loop has data since {utc_text(moment)} UTC{ends}", where=f"--since {since}",
                      remedy="give an earlier time, or an age such as 3d")
