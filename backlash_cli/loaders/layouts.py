"""Which column of a file is what: wide, single-loop, long (a row per sample), tall (rows of a loop), tag pairs."""

import re
from bisect import bisect
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import field, replace
from functools import cached_property
from itertools import chain, pairwise

import numpy as np
import pyarrow as pa

from ..errors import InputError, some
from ..record import Frozen
from .cells import codes_and_words, is_number, is_text, stored, to_array
from .grid import SECOND
from .names import COLUMNS, FORM, SIGNALS, Tag, explained, is_column, is_whole, plain, signal_role, span_of, split_tag
from .options import ReadOptions
from .signals import Series
from .states import mode_words, quality_words
from .times import DATE, DATES, OF_DAY, are_whole, unit_of, unit_of_day

BOUNDS, CLOCK, GROUPS, IGNORED, LOOP, PLACE, TAG, VALUE = (
    COLUMNS[kind] for kind in ("bound", "clock", "group", "ignored", "loop", "place", "tag", "value"))
_OPC = frozenset({*range(0, 256, 4), 219})


class Head(Frozen):
    """The first rows of a file, not yet interpreted. where: path. stem: file name without ending and date. kinds: what
    cells look like ("time", "clock", "number", "text"), or "". home: loop or tag that folders name. Of text:
    first_line, offset: where data begin. end: of what was looked at. As lines above say, or 0 [microseconds]: start
    of times without a date, since 1970; interval between rows."""

    where: str
    stem: str
    names: tuple[str, ...]
    columns: tuple[pa.ChunkedArray, ...]
    kinds: tuple[str, ...]
    home: str
    decimal: str = "."
    delimiter: str = ""
    first_line: int = 0
    offset: int = 0
    end: int = 0
    start: int = 0
    interval: int = 0

    @cached_property
    def plain(self) -> list[str]:
        return [plain(name) for name in self.names]

    @cached_property
    def tags(self) -> list[Tag]:
        return [split_tag(name) for name in self.names]

    @cached_property
    def times(self) -> list[int]:
        """Columns that hold stamps, numeric ones only when their header says so; of intervals, where they begin."""
        called = [i for i, name in enumerate(self.names) if is_column(name, "time")]
        sure = [i for i, column in enumerate(self.columns) if not pa.types.is_null(column.type) and (
            self.is_time(i) or ((i in called or self.tags[i].role == "time") and i in self.numbers))]
        found = [i for i in sure if self.plain[i] not in BOUNDS] or called[:1] or [*filter(self.is_time, sure)][:1]
        if not found:  # a column that goes on, or back, may count since 1970; one that stands first may count anything
            begun = {i: stored(self.columns[i].slice(0, 200), {})[0] for i in self.numbers if not self.tags[i].role}
            steps = {i: np.diff(values) for i, values in begun.items() if np.isfinite(values).all() and len(values) > 1}
            found = [i for i, step in steps.items() if not self.tags[i].loop and (np.all(step > 0) or np.all(step < 0))
                     and unit_of(begun[i], "").startswith("epoch")][:1] or [
                         i for i in steps if 0 in steps and self.names[i] == self.names[0] and min(steps[i]) > 0]
        return sorted({*found, *self.parts}) if "year" in self.parts.values() else found

    @cached_property
    def numbers(self) -> list[int]:
        return [i for i, column in enumerate(self.columns) if is_number(column.type) or self.kinds[i] == "number"]

    @cached_property
    def parts(self) -> dict[int, str]:
        """Columns of numbers that hold year, month, day, hour ... of stamps, and what; dates only if they are whole."""
        found: dict[str, int] = {}
        units = OF_DAY if COLUMNS["year"].isdisjoint(self.plain) else (*DATE, *OF_DAY)
        for i in self.numbers:
            found |= dict.fromkeys([u for u in units if u not in found and self.plain[i] in COLUMNS[u]][:1], i)
        clocks = {i: unit_of_day(self.columns[i], self.names[i]) for i in self.numbers if self.plain[i] in CLOCK}
        date = next((parts for parts in DATES if {*parts} <= found.keys()), ())
        halves = [i for i in self.texts if (self.plain[i] == "ampm" or not self.tags[i].role) and " ".join(
            sorted({word.strip().upper() for word in self.words(i)})) in ("AM", "PM", "AM PM")]
        return clocks | dict.fromkeys(halves, "half") | {i: u for u, i in found.items() if u in (*date, *OF_DAY)}

    @cached_property
    def ids(self) -> list[int]:
        """Columns of tags or loops that are numbers, as keys of a data base are, beside a column of values or of PV."""
        beside = not VALUE.isdisjoint(self.plain) or any(tag.role == "pv" and not tag.loop for tag in self.tags)
        return [i for i in self.numbers if beside and self.plain[i] in TAG | LOOP and pa.types.is_integer(
            self.columns[i].type) and not self.counts(i)]

    @cached_property
    def texts(self) -> list[int]:
        return [i for i, column in enumerate(self.columns) if is_text(column.type)]

    @cached_property
    def loops(self) -> list[int]:
        """Columns that name the loop or tag of a row: the header says so, or several such as FIC101."""
        return [i for i in self.texts + self.ids if self.plain[i] in TAG | LOOP | {"measurement"} or (
            i in self.texts and len(words := self.words(i)) > 1 and all(map(FORM.title.fullmatch, words)))]

    @cached_property
    def places(self) -> list[int]:
        """Columns that say where in the plant a tag is, such as Unit, unless it holds units such as %."""
        return [i for i in self.texts if self.plain[i] in PLACE and (words := self.words(i)) and COLUMNS[
            "attribute"].isdisjoint(map(plain, words))]

    def is_time(self, column: int) -> bool:
        """Say whether a column holds dates or times of day, by its type or by what its first cells look like."""
        kind = self.columns[column].type
        return (pa.types.is_temporal(kind) and not pa.types.is_duration(kind)) or (
            self.kinds[column] in ("time", "clock") and not is_number(kind))

    def words(self, column: int) -> list[str]:
        return [word for word in codes_and_words(self.columns[column].slice(0, 4000))[1] if word.strip()]

    def counts(self, column: int) -> bool:
        """Say whether a column numbers the rows."""
        begun = stored(self.columns[column].slice(0, 200), {})[0]
        return len(begun) > 1 and bool(np.all(np.diff(begun) == 1.0))

    def marks(self, column: int) -> bool:
        """Say whether a column holds qualities by its content: words such as Good, or OPC codes, mostly good."""
        if column in self.texts:
            return quality_words(self.words(column))
        if not pa.types.is_integer(self.columns[column].type):
            return False
        values = to_array(self.columns[column].slice(0, 4000).drop_null())
        return len(values) > 0 and bool(np.mean(values == 192) > 0.5 or (  # beside codes of a product's own
            set(np.unique(values).tolist()) <= _OPC and np.mean(values >= 128) > 0.5))

    def qualities(self, called: list[int]) -> tuple[int, ...]:
        """Those of columns called so whose name tells more, or that hold known words or codes; or the first one."""
        return tuple([i for i in called if re.search("good|bad|valid|question", self.plain[i]) or self.marks(i) or (
            i in self.texts and quality_words(self.words(i), "named"))] or called[:1])


def span_above(column: int, role: str, before: Mapping[int, list[str]]) -> str:
    """The range that lines above a column tell, as [0..60] behind its name: Low and High; 4-20; mA; else nothing."""
    cells = {plain(row[0]): row[column].strip() for row in before.values() if len(row) > column and role in SIGNALS}
    low, high = (next((cell for name, cell in cells.items() if name in COLUMNS[end]), "") for end in ("low", "high"))
    return next((f" [{told}]" for told in (f"{low}..{high}", *cells.values()) if span_of(told, role)), "")


class Layout(Frozen):
    """What the columns are. stamps: of each set of rows the column of its stamps, or those of date and time of day.
    values: of signals. naming: the tag of rows, or loop and signal apart. quality: column -> those that mark it.
    further: hold the value, such as the word of a mode, of rows that have none in `values`."""

    kind: str
    stamps: tuple[Sequence[int], ...]
    values: tuple[int, ...]
    naming: tuple[int, ...] = ()
    quality: dict[int, tuple[int, ...]] = field(default_factory=dict)
    further: tuple[int, ...] = ()


def layout_of(head: Head, options: ReadOptions) -> Layout:
    """Return what the columns are, as the user says or as they look. Raises InputError where one is missing."""
    kind = options.layout or _recognise(head)
    if kind == "pairs":
        return _pairs(head)
    stamps, used = stamp_columns(head, options)
    texts = [i for i in head.texts if i not in used]
    named = sorted((i for i in texts + head.ids if head.plain[i] in GROUPS or i in head.loops), key=lambda i: (
        head.plain[i] not in LOOP, i in head.ids, -len(head.words(i)), -i))[: kind == "tall"]
    naming = name_columns(head, texts) or tuple(head.ids[:1]) if kind == "long" else (
        *[i for i in head.places if named and i not in named], *named)
    if not naming and kind in ("long", "tall"):
        raise InputError(**explained("no_names", what="tag" if kind == "long" else "loop"), where=head.where)
    passed = {*used, *naming, *(i for i in texts if naming and head.plain[i] in GROUPS)}
    values = [i for i, word in enumerate(head.plain) if i not in passed and word not in IGNORED and not head.is_time(i)]
    named = sorted((i for i in values if head.plain[i] in VALUE), key=head.texts.__contains__)  # numbers first
    single = len(named) == 1 and not any(head.tags[i].role in SIGNALS for i in values)  # a tag in a file of its own
    if kind != "long" and (naming or not single):
        return Layout(kind, (stamps,), tuple(values), naming, _quality_beside(head, values))
    rest = [i for i in values if i not in named and len(values) > 1]  # a state that stands alone is the value
    quality = head.qualities([i for i in rest if is_column(head.names[i], "quality")]) or tuple(
        [i for i in rest if head.marks(i)][:1])
    rest = [i for i in values if i not in (*named, *quality)]
    numbers = [i for i in rest if i not in head.texts and not head.counts(i)]
    value = (named or numbers or rest)[:1]
    if not value or (not named and len(numbers) > 1):
        there = some([head.names[i] for i in numbers]) or "none holds numbers"
        raise InputError(**explained("no_values", there=there), where=head.where)
    quality += tuple(i for i in head.texts if head.plain[i] in COLUMNS["measure"] and i not in (*naming, *head.places))
    return Layout(kind, (stamps,), tuple(value), naming, dict.fromkeys(value, quality),
                  tuple(i for i in rest if head.plain[i] in COLUMNS["further"] and i not in value))


def _recognise(head: Head) -> str:
    texts = [i for i in head.texts if i not in head.times]
    alone = {"pv"} < {tag.role for tag in head.tags if tag.role in SIGNALS and not tag.loop}  # else a word for values
    wide = any(map(is_whole, head.names))
    if alone and VALUE.isdisjoint(head.plain):
        return "tall" if {*head.loops} - {*head.times} else "wide"
    followed = all(i + 1 < len(head.names) and i + 1 not in head.times for i in head.times)
    alike = len({(head.is_time(i), head.kinds[i] == "clock") for i in head.times}) == 1  # not stamps and a counter
    if len(head.times) >= 2 and (followed or _leading(head)) and alike and head.kinds[head.times[0]] != "clock" and (
            "hours" not in head.parts.values()):
        return "pairs"
    return "long" if head.times and not wide and (head.ids or name_columns(head, texts)) else "wide"


def stamp_columns(head: Head, options: ReadOptions) -> tuple[Sequence[int], set[int]]:
    """Return the stamps, or date and time of day, and all columns of times. Raises InputError when there is none."""
    if not (columns := head.times):
        raise InputError(**explained("no_time_column"), where=head.where)
    clocks = [i for i in columns if pa.types.is_time(head.columns[i].type) or head.kinds[i] == "clock"]
    parts, halves = head.parts, [i for i, unit in head.parts.items() if unit == "half"]
    of_day = clocks[:1] + [i for i, u in parts.items() if u == "millis" or not (clocks or u in ("", "half", *DATE))]
    whole = [i for i in columns if of_day and i not in clocks and not parts.get(i)]
    dates = [i for i in whole if are_whole(head.columns[i].slice(0, 200), head.names[i], options, head.where)]
    if not clocks and (stamps := [i for i in whole if i not in dates and head.is_time(i)]):  # hours, for partitions
        dates, columns = [], stamps
    if all(parts.get(i) or i in clocks or head.plain[i] == "index" for i in columns):  # no whole stamps
        dates = [i for i, unit in parts.items() if unit in DATE]
    if dates and of_day:
        return (*dates[: None if parts.get(dates[0]) else 1], *of_day, *halves), {*head.times, *parts}
    utc = [i for i in columns if re.search("utc|epoch", head.names[i], re.IGNORECASE)]
    best = min(utc or columns, key=lambda i: (not head.is_time(i), bool(FORM.later.match(head.plain[i])),
                                              not is_column(head.names[i], "time")))
    millis = [i for i, u in parts.items() if u == "millis" and head.is_time(best) and are_whole(
        head.columns[best].slice(0, 200), head.names[best], options, head.where, SECOND)]
    return (best, *millis, *halves), {*head.times, *parts}


def name_columns(head: Head, texts: list[int]) -> tuple[int, ...]:
    """Return which columns of `texts` name the tag of each row, or loop and signal, by cells before headers; or (); and
    before them those that may tell alike tags apart, as unit and module do."""
    heads = {i: words for i in texts if head.plain[i] not in VALUE and (words := head.words(i))}

    def mostly(test: Callable[[str], bool]) -> list[int]:
        return [i for i, words in heads.items() if sum(map(test, words)) >= 0.5 * len(words)]

    whole = mostly(is_whole)
    roles = [i for i in mostly(lambda word: split_tag(word).role in ("sp", "pv", "op") and not split_tag(word).loop)
             if not is_column(head.names[i], "quality")]
    named = [i for i in heads if head.plain[i] in TAG]
    found, beside = named[:1], {*head.places}
    if whole:  # ns=2;s=FIC101.PV says it all, whatever stands beside it
        one = next((i for i in whole if i in named), whole[0])  # pid_pv beside a column that names the loop
        apart = [i for i in heads if head.plain[i] in LOOP and not any(
            loop.lower() in tag.lower() for tag in heads[one] for loop in heads[i])]
        found, beside = [*apart[:1], one], beside | {i for i in heads if head.plain[i] in (TAG | GROUPS) - LOOP - PLACE}
    elif roles:
        rest = [i for i in heads if i not in roles and not is_column(head.names[i], "ignored", "quality")]
        group = [i for i in rest if head.plain[i] in GROUPS | LOOP]
        groups = [i for i in group if head.plain[i] != "measurement"] or (
            [i for i in rest if i in named] or group or rest or head.ids)  # a tag tells more than a measurement
        found = [max(groups, key=lambda i: (head.plain[i] in LOOP, len(head.words(i)))), roles[0]] if groups else found
    return (*sorted(beside.difference(found), key=lambda i: len(head.words(i))), *found) if found else ()


def _leading(head: Head) -> int:
    """How many columns stand before the time of each block of a value, its time and perhaps its quality."""
    steps = {after - before for before, after in pairwise(head.times)}
    lead = max(steps, default=0) - len(head.names) + max(head.times, default=0)
    return lead if len(steps) == 1 and 0 < lead <= head.times[0] and all(
        head.names[i - 1] and i - 1 not in {*head.times, *head.texts} for i in head.times) else 0


def _pairs(head: Head) -> Layout:
    """Every tag, or some of them, has a time column of its own, shorter ones padded with empty cells."""
    lead, stamps, values, quality = _leading(head), list[tuple[int]](), list[int](), dict[int, tuple[int, ...]]()
    for column, end in zip(head.times, [*head.times[1:], len(head.names) + lead], strict=True):
        block = [i for i in range(column - lead, end - lead) if i != column and (
            head.names[i] or not pa.types.is_null(head.columns[i].type))]
        marks = [i for i in block if is_column(head.names[i], "quality") or head.tags[i].role == "quality"]
        first, *others = [i for i in block if i not in marks] or [-1]
        others = [i for i in others if head.tags[i].loop and head.tags[i].role in SIGNALS]
        if first >= 0:
            stamps.append((column,))
            values += [first, *others]
            quality |= _quality_beside(head, block) if others else {first: head.qualities(marks)}
    return Layout("pairs", tuple(stamps), tuple(values), quality=quality)


def _quality_beside(head: Head, values: Collection[int]) -> dict[int, tuple[int, ...]]:
    """Columns of quality by the columns they mark: by name, in turn, the one before, or all for one at either end."""
    signals = [i for i in values if head.tags[i].role in ("sp", "pv", "op")]
    values = [i for i in values if i not in head.texts or head.tags[i].role == "mode" or not mode_words(head.words(i))]
    words = {i: head.plain[i].rstrip("0123456789") for i in values}
    alike = [i for i, word in words.items() if word in COLUMNS["quality"] and (  # Quality; Q1, Q2, Q3; no OP.Quality
        word == head.plain[i] or head.marks(i))]
    roles, kinds = [i for i in values if head.tags[i].role in SIGNALS], {words[i] for i in alike}
    of_row = len(signals) > 1 and len(kinds) == len(alike) and not any(min(signals) < i < max(signals) for i in alike)
    marked = signals if of_row else next((x for x in (roles, signals) if len(x) == len(alike) and len(kinds) == 1), [])
    quality = {i: head.qualities(alike) if of_row else (alike[k],) for k, i in enumerate(marked)}
    owners, there = {(head.tags[i].loop, head.tags[i].role): i for i in roles}, {*values}
    for i in (i for i in values if not marked or i not in alike):
        tag, of, before = head.tags[i], split_tag(head.tags[i].of), i - 1
        of_loop = owners.get((tag.of, "pv"), -1) if head.marks(i) or re.search("bad|qual|valid", head.plain[i]) else -1
        owner = -1 if tag.role != "quality" else head.names.index(tag.of) if tag.of in head.names else owners.get(
            (of.loop, of.role), of_loop)  # FIC101.PV_QUALITY of FIC101.PV_VALUE; FIC101.BadPV
        beside = before in there and before not in alike and (not tag.of or tag.loop == head.tags[before].loop or (
            of.loop, of.role) == ("", head.tags[before].role))  # PV Status
        if owner < 0 and beside and (tag.role == "quality" or is_column(head.names[i], "quality") or (
                not tag.role and i in head.texts and before not in head.texts and head.marks(i))):
            owner = before
        if owner >= 0:
            quality[owner] = (*quality.get(owner, ()), i)
    return quality


def signals_of(head: Head, layout: Layout, options: ReadOptions, blank: Collection[int] = ()) -> list[Series]:
    """Name the signals of a wide file or of pairs; blank: columns without any cell. Raises InputError without any. What
    folders or file are called completes a header that names no loop; "value" stands for what its time column is."""
    pairs, marks, tags, stem = layout.kind == "pairs", {*chain(*layout.quality.values())}, head.tags, head.stem
    signals = [i for i in layout.values if pairs or (i not in marks and (tags[i].role or i not in blank))]
    stems = {i for i in signals if head.plain[i] in COLUMNS["stem"]}  # lie behind the play: no OP beside a demand
    main = [i for i in signals if i not in stems] if {tags[i].role for i in {*signals} - stems} >= {"op"} else signals
    loops = {tags[i].role: tags[i].loop for i in main if tags[i].role in ("sp", "pv", "op")}
    bare = [i for i in main if not (tags[i].role or tags[i].loop) and "pv" not in loops and (
        tags[i].signal == loops.get("sp") or (loops.get("sp") == "" and head.plain[i] in COLUMNS["quantity"]))]
    # Flow Set Point, Flow, Valve Demand: in words and not by a tag
    in_words = {"sp", "op"} <= loops.keys() and ("pv" in loops or len(bare) == 1) and len({*loops.values()}) > 1 and (
        len(loops) == sum(tags[i].role in loops for i in main) and not re.search(r"\d", "".join(loops.values())))
    bare_roles, named = ({tags[i].role for i in signals if bool(tags[i].loop) is x} & {*SIGNALS} for x in (False, True))
    alone = not pairs and (in_words or len(bare_roles) > 1 or bool(bare_roles - named)) and not (len(signals) == 1 and (
        head.plain[signals[0]] in COLUMNS["attribute"] or (is_whole(stem) and split_tag(stem).role in bare_roles)))
    only = not pairs and not alone and len(signals) == 1 and not (tags[signals[0]].loop and tags[signals[0]].role)
    by_signal = signal_role(stem) in ("sp", "pv", "op") and not any(
        tag.role in SIGNALS or name.lower() in options.tags for tag, name in zip(tags, head.names, strict=True))
    found, begins = [], [column - _leading(head) for column, *_ in layout.stamps]
    for i in signals:
        place, name = bisect(begins, i) - 1 if pairs else 0, head.names[i]
        if pairs and (not name or not VALUE.isdisjoint((head.plain[i], plain(name.rpartition(".")[2])))):
            time = layout.stamps[place][0]
            name = tags[time].of or name.rpartition(".")[0] or head.names[time]
        elif only and (not name or head.plain[i] in VALUE or (not tags[i].loop and split_tag(stem).role in SIGNALS)):
            name = stem if split_tag(stem).role in SIGNALS and not split_tag(head.home).role else head.home or stem
        elif by_signal:  # the file, or sheet, of all PV with a column per loop
            name = f"{name}.{stem}"
        one = of_tag(head, layout, name, i, place)
        if one.role in ("", "mode") and i in head.texts and mode_words(head.words(i)):  # FIC101.Loop Status: AUTO
            owner = max((tag.loop for tag in tags if tag.role == "pv" and name.startswith(tag.loop) and not (
                tag.loop and name[len(tag.loop) :][:1].isalnum())), key=len, default=tags[i].of or one.loop)
            if not any(tag.role == "mode" and tag.loop == owner for tag in tags):
                one = replace(one, loop=owner, role="mode")
        if alone and ((in_words and one.role) or bare == [i]):
            one = replace(one, loop="", role=one.role or "pv")
        if alone and (head.home or not one.loop or not one.role):
            one = replace(one, loop=head.home or stem, signal=one.signal if one.role or not one.loop else head.names[i])
        found.append(one)
    if not found:
        raise InputError(**explained("no_signals", shown=some(head.names)), where=head.where)
    return found


def of_tag(head: Head, layout: Layout, name: str, column: int, place: int = 0) -> Series:
    """The signal that a tag names, in a column of cells with the stamps of a place in the layout."""
    tag, marks = split_tag(name), {i: head.names[i] for i in layout.quality.get(column, ())}
    return Series(name, tag.loop, tag.role if tag.role in SIGNALS else "", tag.signal, column, place, marks)
