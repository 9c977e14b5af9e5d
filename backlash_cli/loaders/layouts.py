"""Which column of a file is what: wide, single-loop, long (a row per sample), tall (rows of a loop), tag pairs.

Decided from the first rows of a file, before the rest is read.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
import pyarrow as pa

from ..errors import InputError
from .names import IGNORED, LOOP, SIGNALS, TAG, VALUE, Tag, is_quality_name, is_time_name, plain, signal_role, split_tag
from .numbers import codes_and_words, is_number, is_text
from .options import ReadOptions
from .quality import quality_words
from .times import is_midnight

GROUPS = LOOP | {"measurement", "device", "unit", "block"}
_BOUNDS = ("start", "stop", "end", "from", "to", "begin", "starttime", "endtime", "stoptime", "intervalstart")
_OPC = frozenset(range(0, 256, 4)) | {216, 219}


@dataclass(frozen=True)
class Head:
    """The first rows of a file, nothing interpreted yet.

    where: path for messages. stem: file name without endings. first_line: line of the first row in a text file, 0 for
    others. partition: names and values of folders like loop=FIC101. kinds: what the first cells of a text look like.
    """

    where: str
    stem: str
    names: tuple[str, ...]
    columns: tuple[pa.ChunkedArray, ...]
    decimal: str = "."
    first_line: int = 0
    partition: dict[str, str] = field(default_factory=dict)
    kinds: tuple[str, ...] = ()

    def is_text(self, column: int) -> bool:
        """Say whether a column holds text."""
        return is_text(self.columns[column].type)

    def kind(self, column: int) -> str:
        """What the first cells of a column look like ("time", "clock", "number", "text"), "" where nobody looked."""
        return self.kinds[column] if column < len(self.kinds) else ""

    def words(self, column: int) -> list[str]:
        """Return the texts in the first rows of a column."""
        return [word for word in codes_and_words(self.columns[column].slice(0, 4000))[1] if word.strip()]


@dataclass(frozen=True)
class Layout:
    """What the columns of a file are. stamps: of each set of rows the column of its stamps, or those of date and time
    of day. values: columns with signals. naming: of long and tall files the tag, or loop and signal apart. quality:
    column of values -> column that marks it."""

    kind: str
    stamps: tuple[tuple[int, ...], ...]
    values: tuple[int, ...]
    naming: tuple[int, ...] = ()
    quality: dict[int, int] = field(default_factory=dict)

    @property
    def stored(self) -> list[int]:
        """Columns of cells."""
        return sorted({*self.values, *self.quality.values()})


@dataclass(frozen=True)
class Named:
    """A column whose signal is known. stamps: place of its set of rows in the layout."""

    column: int
    tag: str
    loop: str
    role: str
    signal: str
    stamps: int = 0


def layout_of(head: Head, options: ReadOptions) -> Layout:
    """Return what the columns are, as the user says or as they look. Raises InputError where one is missing."""
    kind = options.layout or _recognise(head)
    if kind == "pairs":
        return _pairs(head)
    stamps, used = stamp_columns(head, options)
    if kind == "long":
        return _long(head, stamps, used)
    if kind == "tall":
        return _tall(head, stamps, used)
    values = tuple(i for i, name in enumerate(head.names)
                   if i not in used and plain(name) not in IGNORED and not is_time_like(head, i))
    return Layout("wide", (stamps,), values, quality=_quality_beside(head, values))


def _recognise(head: Head) -> str:
    words = [plain(name) for name in head.names]
    times = time_columns(head)
    texts = [i for i in range(len(words)) if head.is_text(i) and i not in times]
    roles = [split_tag(name) for name in head.names]
    alone = {tag.role for tag in roles if not tag.loop and tag.role in SIGNALS}
    wide = any(tag.loop and tag.role in SIGNALS for tag in roles)
    if "pv" in alone and not any(word in VALUE for word in words):
        return "tall" if any(words[i] in TAG | LOOP | {"measurement"} for i in texts) else "wide"
    followed = all(i + 1 < len(words) and i + 1 not in times for i in times)
    if len(times) >= 2 and followed and not any(head.kind(i) == "clock" for i in times):
        return "pairs"
    return "long" if texts and times and not wide and name_columns(head, texts) else "wide"


@lru_cache(1 << 16)
def _of_time(name: str) -> tuple[bool, bool]:
    """Whether a column is called after the begin or end of something, and whether after the time."""
    return plain(name) in _BOUNDS, is_time_name(name) or split_tag(name).role == "time"


def is_time_like(head: Head, column: int) -> bool:
    """Say whether a column holds dates or times of day (by type, or by what its first cells look like)."""
    kind = head.columns[column].type
    return (pa.types.is_temporal(kind) and not pa.types.is_duration(kind)) or (
        head.kind(column) in ("time", "clock") and not is_number(kind))


def time_columns(head: Head) -> list[int]:
    """Return the columns that hold stamps, numeric ones only when their header says so."""
    found = []
    for i, name in enumerate(head.names):
        bound, named = _of_time(name)
        if not bound and not pa.types.is_null(head.columns[i].type) and (
                is_time_like(head, i) or (named and is_number(head.columns[i].type))):
            found.append(i)
    if not found:
        found = [i for i, name in enumerate(head.names) if is_time_name(name)][:1]
    first = head.columns[0] if head.columns else None
    if not found and first is not None and is_number(first.type) and not split_tag(head.names[0]).role:
        begin = first.slice(0, 200).cast(pa.float64(), safe=False).to_numpy()
        found = [0] if len(begin) > 1 and bool(np.all(np.diff(begin) > 0)) else []
    return found


def stamp_columns(head: Head, options: ReadOptions) -> tuple[tuple[int, ...], set[int]]:
    """Return the column of the stamps, or those of date and time of day, and all columns that hold times.

    Raises InputError when there is none.
    """
    columns = time_columns(head)
    if not columns:
        raise InputError("no time column found", where=head.where, remedy="name the column of time stamps 'timestamp', "
                         "or say how they are written with --time-format")
    clocks = [i for i in columns if pa.types.is_time(head.columns[i].type) or head.kind(i) == "clock"]
    dates = [i for i in columns if i not in clocks]
    if clocks and dates and is_midnight(head.columns[dates[0]], head.names[dates[0]], options, head.where):
        return (dates[0], clocks[0]), {dates[0], clocks[0]}
    utc = [i for i in columns if "utc" in plain(head.names[i]) or "epoch" in plain(head.names[i])]
    named = [i for i in columns if is_time_name(head.names[i])]
    return ((utc or named or columns)[0] if len(columns) > 1 else columns[0],), set(columns)


def name_columns(head: Head, texts: list[int]) -> tuple[int, ...]:
    """Return the columns that name the tag of each row: one with whole tags, or loop and signal apart; () if none.

    texts: the text columns beside the stamps. What stands in a column counts more than its header.
    """
    words = {i: plain(head.names[i]) for i in texts}
    heads = {i: head.words(i) for i in texts}
    whole = [i for i in texts if _share(heads[i], lambda w: bool(split_tag(w).loop) and split_tag(w).role in SIGNALS)]
    roles = [i for i in texts if _share(heads[i], lambda w: signal_role(w) != "")]
    if roles:
        rest = [i for i in texts if i not in roles and heads[i] and words[i] not in IGNORED
                and not is_quality_name(words[i])]
        groups = [i for i in rest if words[i] in GROUPS] or [i for i in rest if words[i] in TAG] or rest
        if groups:
            return max(groups, key=lambda i: (words[i] in LOOP, len(heads[i]))), roles[0]
    if whole:
        return (next((i for i in whole if words[i] in TAG), whole[0]),)
    return tuple([i for i in texts if words[i] in TAG and heads[i]][:1])


def _share(words: list[str], test: Callable[[str], bool]) -> bool:
    """Whether half of the words pass a test."""
    return bool(words) and sum(map(test, words)) >= 0.5 * len(words)


def _long(head: Head, stamps: tuple[int, ...], used: set[int]) -> Layout:
    words = [plain(name) for name in head.names]
    columns = range(len(words))
    naming = name_columns(head, [i for i in columns if head.is_text(i) and i not in used])
    if not naming:
        raise InputError("no column of tag names found", where=head.where, remedy="name it 'tag'")
    taken = {*naming, *used}
    free = [i for i in columns if i not in taken and words[i] not in IGNORED and not is_time_like(head, i)]
    named = [i for i in free if words[i] in VALUE]
    quality = next((i for i in free if is_quality_name(words[i]) and i not in named), None)
    if quality is None and len(free) > 1:
        quality = next((i for i in free if i not in named and _marks(head, i)), None)
    free = [i for i in free if i != quality]
    values = named or [i for i in free if not head.is_text(i)] or free
    if not values:
        raise InputError("no column of values found", where=head.where, remedy="name it 'value'")
    return Layout("long", (stamps,), (values[0],), naming, {} if quality is None else {values[0]: quality})


def _marks(head: Head, column: int) -> bool:
    """Say whether a column holds qualities by its content: words such as Good, or OPC codes that are mostly good."""
    if head.is_text(column):
        words = head.words(column)
        return bool(words) and quality_words(words)
    if not pa.types.is_integer(head.columns[column].type):
        return False
    values = head.columns[column].slice(0, 4000).drop_null().to_numpy()
    return len(values) > 0 and set(np.unique(values).tolist()) <= _OPC and bool(np.mean(values >= 192) > 0.5)


def _tall(head: Head, stamps: tuple[int, ...], used: set[int]) -> Layout:
    words = [plain(name) for name in head.names]
    texts = [i for i in range(len(words)) if head.is_text(i) and i not in used]
    which = next((i for i in texts if words[i] in GROUPS), next((i for i in texts if words[i] in TAG), None))
    if which is None:
        raise InputError("no column of loop names found", where=head.where, remedy="name it 'loop'")
    values = [i for i, word in enumerate(words) if i not in used and i != which and word not in IGNORED
              and not is_quality_name(word)]
    return Layout("tall", (stamps,), tuple(values), (which,))


def _pairs(head: Head) -> Layout:
    """Every tag has a time column of its own, shorter ones padded with empty cells."""
    times = time_columns(head)
    stamps, values, quality = [], [], {}
    for column, end in zip(times, [*times[1:], len(head.names)], strict=True):
        block = [i for i in range(column + 1, end) if head.names[i] or not pa.types.is_null(head.columns[i].type)]
        marks = [i for i in block if is_quality_name(plain(head.names[i]))
                 or split_tag(head.names[i]).role == "quality"]
        signals = [i for i in block if i not in marks]
        if signals:
            stamps.append((column,))
            values.append(signals[0])
            if marks:
                quality[signals[0]] = marks[0]
    return Layout("pairs", tuple(stamps), tuple(values), quality=quality)


def _quality_beside(head: Head, values: Collection[int]) -> dict[int, int]:
    """Columns of quality by the columns they mark: by name, or the one before."""
    by_name = {name: i for i, name in enumerate(head.names)}
    quality: dict[int, int] = {}
    for i in values:
        tag = split_tag(head.names[i])
        before = i - 1 if i - 1 in values else None
        if tag.role == "quality" and tag.of in by_name:
            quality[by_name[tag.of]] = i
        elif before is not None and (not tag.of or split_tag(head.names[before]).loop == tag.loop) and (
                tag.role == "quality" or is_quality_name(plain(head.names[i]))
                or (not tag.role and head.is_text(i) and not head.is_text(before) and _marks(head, i))):
            quality[before] = i
    return quality


def signals_of(head: Head, layout: Layout, empty: Collection[int] = ()) -> list[Named]:
    """Name the signals of a wide file or of pairs. empty: columns without any cell. Raises InputError without any."""
    if layout.kind == "pairs":
        found = [_of_pair(head, column, stamps[0], k)
                 for k, (column, stamps) in enumerate(zip(layout.values, layout.stamps, strict=True))]
    else:
        found = _wide(head, layout, empty)
    if not found:
        shown = ", ".join((name or "(blank)")[:40] for name in head.names[:8]) + ", ..." * (len(head.names) > 8)
        raise InputError(f"no signal columns found beside the time (columns: {shown})", where=head.where,
                         remedy="name columns LOOP.SP, LOOP.PV, LOOP.OP, or name the tags in loops.toml")
    return found


def _of_pair(head: Head, column: int, time: int, place: int) -> Named:
    name = head.names[column]
    if not name or plain(name) in VALUE or plain(name.rpartition(".")[2]) in VALUE:
        name = split_tag(head.names[time]).of or name.rpartition(".")[0] or head.names[time]
    return of_tag(name, column, place)


def of_tag(name: str, column: int, place: int = 0) -> Named:
    """The signal that a tag names."""
    tag = split_tag(name)
    return Named(column, name, tag.loop, tag.role if tag.role in SIGNALS else "", tag.signal, place)


def _wide(head: Head, layout: Layout, empty: Collection[int]) -> list[Named]:
    roles = {i: split_tag(head.names[i]) for i in layout.values}
    of_quality = set(layout.quality.values())
    signals = [i for i in layout.values if i not in of_quality and (roles[i].role or i not in empty)]
    alone = {roles[i].role for i in signals if not roles[i].loop and roles[i].role in SIGNALS}
    home = _partition_name(head)
    if not alone and len(signals) == 1 and not (roles[signals[0]].loop and roles[signals[0]].role):
        return [_one_tag(head, signals[0], home)]
    found = []
    for i in signals:
        tag, loop = roles[i], roles[i].loop
        if not loop:
            loop = "" if not alone and tag.role not in SIGNALS else home or head.stem
        elif alone and tag.role not in SIGNALS:
            loop, tag = home or head.stem, Tag("", "", head.names[i])
        elif home and alone:
            loop = home
        found.append(Named(i, head.names[i], loop, tag.role if tag.role in SIGNALS else "", tag.signal))
    return found


def _partition_name(head: Head) -> str:
    """The loop or tag that the folders name: loop=FIC101, tag=FIC101.PV, or loop=FIC101/signal=PV."""
    loop = next((v for k, v in head.partition.items() if plain(k) in LOOP), "")
    rest = [v for k, v in head.partition.items() if plain(k) in TAG]
    role = next((v for v in rest if signal_role(v)), "")
    if role and (loop or len(rest) > 1):
        return f"{loop or next(v for v in rest if v != role)}.{role}"
    return loop or (rest[0] if rest else "")


def _one_tag(head: Head, value: int, home: str) -> Named:
    """A file with one signal: its header, or else the file name, is the tag."""
    header = head.names[value]
    generic = plain(header) in VALUE or not header
    name = (home or head.stem) if generic else header
    if not generic and not split_tag(name).loop and split_tag(head.stem).role in SIGNALS:
        name = head.stem
    return of_tag(name, value)
