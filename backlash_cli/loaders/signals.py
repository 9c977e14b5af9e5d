"""Recorded signals: their stamps and cells and where they lie, read when a loop asks, and which of them make a loop."""

from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property, lru_cache, partial
from itertools import accumulate, chain
from typing import Any, Self

import numpy as np

from ..errors import LoopError, some
from ..record import NAT, BoolArray, FloatArray, Frozen, IntArray, Note
from ..samples import changed_size, no_values
from ..scratch import Columns
from ..settings import Metadata
from .cells import Cells
from .grid import Times
from .names import COLUMNS, FORM, SIGNALS, bare_tag, explained, noted, plain
from .states import good_samples

PIECE = 1 << 20  # rows that are looked at together
MOST_TIMES = 8  # kept: more than one loop has, and few enough for plants of many files
Owners = dict[str, list[tuple[str, str]]]  # tag in lower case -> (loop, role) of each that the metadata give it
Faults = dict[tuple[str, str], Counter[str]]  # (what is wrong, tag) -> what stood there, counted


class Store(Columns):
    """Stamps and cells of a file: texts of the column "v3" are kept by their places in the lexicon, in "v3w"."""

    def cells(self, column: str, first: int, last: int, group: int = 0) -> Cells:
        values, lexicon = self.read(column, first, last, group), self.lexicons.get(column)
        return Cells(values, self.read(f"{column}w", first, last, group), lexicon) if lexicon else Cells(values)

    stamps = Columns.read  # [microseconds since 1970 UTC], NAT where unreadable


class Axis(Frozen, eq=False):
    """Rows that belong together, and the `column` of their stamps, which all signals recorded in these rows share.
    which: of the rows, or of a group. where, called: file, part of it. first_line: of row 0. zones: of StampReader."""

    rows: Any  # of a file, with the methods `cells` and `stamps` of a Store
    column: str
    which: range | IntArray
    group: int = 0
    notes: tuple[Note, ...] = ()
    where: str = ""
    called: str = ""
    first_line: int = 0
    zones: frozenset[bool | None] = frozenset()

    def __len__(self) -> int:
        return len(self.which)

    def _base(self, first: int, last: int) -> tuple[tuple[int, int, int], slice | IntArray]:
        """Between which rows of the file these lie, and which of those they are."""
        which = self.which[first:last]
        if isinstance(which, range):
            return (which.start, which.stop, self.group), slice(None)
        begin, end = (int(which.min()), int(which.max()) + 1) if len(which) else (0, 0)
        return (begin, end, self.group), which - begin

    def read(self, first: int = 0, last: int | None = None) -> IntArray:
        """Return the stamps of rows first..last-1: microseconds since 1970 UTC, NAT where unreadable."""
        between, taken = self._base(first, len(self) if last is None else last)
        return self.rows.stamps(self.column, *between)[taken]

    def cells(self, column: str) -> Cells:
        between, taken = self._base(0, len(self))
        return self.rows.cells(column, *between)[taken]

    def pieces(self) -> Iterator[IntArray]:
        return (self.read(first, min(first + PIECE, len(self))) for first in range(0, len(self), PIECE))

    @cached_property
    def first(self) -> int:
        """Return the first stamp that was read, 0 if there is none."""
        pieces = chain([self.read(0, min(1, len(self)))], self.pieces())
        return next((int(piece[known][0]) for piece in pieces if (known := piece != NAT).any()), 0)

    def last(self) -> int:
        """Return the last stamp, NAT if there is none."""
        return max((int(piece.max()) for piece in self.pieces()), default=NAT)

    def part(self, chosen: slice | IntArray) -> Self:
        if isinstance(chosen, slice):
            line = self.first_line and self.first_line + int(chosen.start or 0)
            return replace(self, which=self.which[chosen], first_line=line)
        return replace(self, which=np.asarray(self.which)[chosen], first_line=0)


class Series(Frozen, eq=False):
    """One signal of one file. tag: its name as written. loop, role, signal: its parts. column: of the file.
    stamps: its set of rows in the layout. marks: columns that say what is good, and their names. axis: rows."""

    tag: str
    loop: str
    role: str
    signal: str
    column: int
    stamps: int = 0
    marks: dict[int, str] = field(default_factory=dict)
    axis: Axis = field(default=None)  # type: ignore[assignment]

    def cells(self) -> Cells:
        return self.axis.cells(f"v{self.column}")


@dataclass
class LoopSeries:
    """All recorded signals of one loop: role ("sp", "pv", "op", "mode") or column name -> series in file order."""

    name: str
    roles: dict[str, list[Series]] = field(default_factory=dict)
    extra: dict[str, list[Series]] = field(default_factory=dict)
    missing_tags: dict[str, str] = field(default_factory=dict)

    def changed(self, change: Callable[[Axis], Axis]) -> Self:
        """Return it with other rows in the place of its own, also shared ones; without signals that have none left."""
        once = cache(change)
        roles, extra = ({name: there for name, items in signals.items() if (there := [replace(item, axis=axis)
            for item in items if len(axis := once(item.axis))])} for signals in (self.roles, self.extra))
        return replace(self, roles=roles, extra=extra)


class Signal(Frozen, eq=False):
    """One signal over all files. values: (rows,) nan where blank or bad. faults: counted, by what is wrong and tag."""

    times: Times
    values: FloatArray
    bad: BoolArray
    notes: tuple[Note, ...] = ()
    faults: Faults = field(default_factory=dict)


def by_loop(series: Sequence[Series], metadata: Metadata) -> dict[str, LoopSeries]:
    """Assign every series to a loop; tags named in the metadata go where it says."""
    (explicit, asked), loops = explicit_tags(metadata), dict[str, LoopSeries]()

    def own(name: str) -> LoopSeries:
        return loops.setdefault(name, LoopSeries(name))

    # loops that the metadata know by another spelling or by a whole part of the name, one by one
    signals = defaultdict[str, set[str]](set)  # of a loop, those of its blocks together
    for item in series:
        signals[FORM.block.sub("", item.loop)] |= {item.role} - {""}
    present = {item.loop for item in series if item.loop and item.role} if metadata.loops else set()
    found = {name: metadata.match(name) or metadata.part_of(name) for name in present - metadata.loops.keys()}
    full = {match for name, match in found.items() if len(signals[FORM.block.sub("", name)]) > 1}
    found = {name: match for name, match in found.items() if len(signals[FORM.block.sub("", name)]) > (match in full)}
    counts = Counter({FORM.block.sub("", name): match for name, match in found.items()}.values())
    renamed = {name: match for name, match in found.items() if match and counts[match] == 1 and match not in present}
    renamed = {name: one for name, one in _devices(signals).items() if name not in metadata.loops} | renamed
    spelt: dict[str, str] = {}
    shared = defaultdict[str, set[str]](set)  # signals of a loop that the metadata give to another
    for item in series:
        name = spelt.setdefault((found_name := renamed.get(item.loop, item.loop)).lower(), found_name)
        owners = owners_of(item.tag, explicit)
        if item.loop and item.loop.lower() not in item.tag.lower():  # "w" of the file FIC101.csv, or of its own loop
            owners = [one for one in owners or owners_of(f"{name}.{item.tag}", explicit) if one[0] == name] or owners
        for loop, role in owners:
            own(loop).roles.setdefault(role, []).append(item)
        # unless the metadata name another tag for this signal; the OP of one loop may be the SP of another as well
        recast = name in dict(owners) and plain(item.signal) != item.role  # MV may well be PV; PV as OP is a mistake
        if item.loop and not recast and not (item.role in asked.get(name, {}) if item.role else owners):
            (own(name).roles if item.role else own(name).extra).setdefault(item.role or item.signal, []).append(item)
            shared[name] |= {item.role} if owners else set()
    bare = defaultdict[str, list[Series]](list)
    for item in series:
        bare["" if item.role else bare_tag(item.tag)].append(item)
    for name, one in loops.items():  # FIC101.DACA.PV beside FIC101.PIDA.SP
        bare[bare_tag(FORM.block.sub("", name))] += one.roles["pv"] if one.roles.keys() == {"pv"} else []
    for name, one in loops.items():  # FIC101, or FIC101.Value, beside FIC101.SP and FIC101.OP is the measurement
        called = COLUMNS["value"] | (COLUMNS["quantity"] if {"sp", "op"} <= one.roles.keys() else set())
        of_value = [items for signal, items in one.extra.items() if plain(signal) in called]
        names = [name, *(items[0].loop for items in one.roles.values())]  # in the loops file, and in the data
        values = next(filter(None, (bare.get(bare_tag(FORM.block.sub("", one_name))) for one_name in names)),
                      of_value[0] if len(of_value) == 1 else None)
        if one.roles and values and len({item.loop for item in values}) == 1 and "pv" not in asked.get(name, {}):
            one.roles.setdefault("pv", values)
        outputs = one.roles.get("op", [])
        words = [plain(item.signal) for item in outputs]  # beside another output CV is controlled, or MV measured
        measured = [o for o, word in zip(outputs, words, strict=True) if word in sorted({"cv", "mv"} & {*words})[:1]]
        if "pv" not in one.roles.keys() | asked.get(name, {}).keys() and 0 < len(measured) < len(outputs):
            one.roles |= {"pv": measured, "op": [item for item in outputs if item not in measured]}
    for loop, tags in asked.items():
        own(loop).missing_tags |= {role: tag for role, tag in tags.items() if role not in own(loop).roles}
    return {name: loop for name, loop in loops.items() if loop.roles and (  # not a loop if others have its signals
        name in asked or not shared[name] or len(loop.roles.keys() - shared[name]) > 1)}


def _devices(signals: Mapping[str, set[str]]) -> dict[str, str]:
    """What stands for a controller whose signals carry the names of devices (ISA 5.1): FIC101.SP, FT101.PV."""
    families = defaultdict[tuple[str, ...], list[tuple[str, str]]](list)
    for name, roles in signals.items():
        if found := FORM.device.fullmatch(name):
            families[found.groups("")] += [(role, name) for role in roles]
    once = [of_role for own in families.values() if len(of_role := dict(own)) == len(own)]  # each signal
    return {name: own["sp"] for own in once if {"sp", "pv", "op"} <= own.keys() for name in own.values()}


def explicit_tags(metadata: Metadata) -> tuple[Owners, dict[str, dict[str, str]]]:
    """Return the tags that the metadata name: tag in lower case -> (loop, role) of each, and loop -> role -> tag."""
    explicit, asked = Owners(), {loop: values.tags for loop, values in metadata.loops.items()}
    for loop, (role, tag) in ((loop, pair) for loop, tags in asked.items() for pair in tags.items()):
        explicit.setdefault(tag.lower(), []).append((loop, role))
    return explicit, asked


def owners_of(tag: str, explicit: Owners) -> list[tuple[str, str]]:
    """Return (loop, role) of those that the metadata give a tag, as it is written or without server and unit."""
    return explicit.get(tag.strip().lower()) or explicit.get(bare_tag(tag)) or []


class Joiner:
    """Joins the parts of signals; signals whose parts lie in the same rows share their times."""

    def __init__(self, good_quality: tuple[str, ...] = ()) -> None:
        self.good_quality = good_quality
        self.only: tuple[int, int] | None = None  # stamps between which faults are counted, in the chunks of a loop
        self._marks: dict[tuple[str, ...], dict[str, Any]] = {}  # what earlier chunks tell of a quality's numbers
        self.times = lru_cache(MOST_TIMES)(partial(_times, [Times(np.zeros(0, np.int64))]))

    def signal(self, series: list[Series], role: str = "") -> Signal:
        """Return one signal from its series. Raises LoopError when two different columns carry one name."""
        chosen, notes = one_per_file(series, role)
        chosen = sorted(chosen, key=lambda item: item.axis.first) if len(chosen) > 1 else chosen
        parts = [self._part(item) for item in chosen]
        faults: Faults = parts[0].faults
        for part in parts[1:]:
            add_faults(faults, part.faults)
        said = {(note.code, note.message): note for part in parts for note in part.notes}
        one = parts[0] if len(parts) == 1 else agreed(Signal(self.times(*(item.axis for item in chosen)),
            np.concatenate([p.values for p in parts]), np.concatenate([p.bad for p in parts])), chosen[0].tag)
        units, points = changed_size(one.values) if role in ("pv", "op") else (0, 0)
        faults |= {(code, chosen[0].tag): Counter({"": count})
                   for code, count in (("unit_change", units), ("points_lost", points))}
        return replace(one, notes=(*said.values(), *notes), faults=faults)

    def _part(self, item: Series) -> Signal:
        cells, good, notes = item.cells(), np.ones(len(item.axis), bool), list[Note]()
        (values, bad), times = cells.numbers(), self.times(item.axis)
        own = slice(None) if self.only is None else slice(*np.searchsorted(times.micros, self.only).tolist())
        faults: Faults = {("not_numbers", item.tag): cells.words(bad, own)}
        for column, name in item.marks.items():  # good is what all of them call so
            known = {} if self.only is None else self._marks.setdefault((item.axis.where, item.tag, name), {})
            called, more = good_samples(item.axis.cells(f"v{column}"), self.good_quality, name, known)
            good, notes = good & called, [*notes, *more]
        for code in ("bad_quality", "no_values"):
            wrong = no_values(values) if code == "no_values" else ~good if item.marks else None
            faults[code, item.tag] = Counter({code: 0 if wrong is None else int(np.count_nonzero(wrong[own]))})
            if wrong is not None and wrong.any():
                bad, values = bad | wrong, np.where(wrong, np.nan, values)
        return Signal(times, values, bad, tuple(notes), faults)


def _times(last: list[Times], *axes: Axis) -> Times:
    """The stamps of all rows of some axes. last: files of one recording have the same ones, put on a grid once."""
    micros, rows, known = [axis.read() for axis in axes], [0, *accumulate(map(len, axes[:-1]))], last[0]
    found = Times(micros[0] if len(axes) == 1 else np.concatenate(micros), tuple(n for a in axes for n in a.notes),
        tuple((k, a.where + f": {a.called}" * (a.called not in a.where)) for k, a in zip(rows, axes, strict=True)),
        axes[0].first_line * (len(axes) == 1))
    if not (known.in_order and found.notes == known.notes and np.array_equal(found.micros, known.micros)):
        last[0] = found
    return last[0]


def agreed(signal: Signal, tag: str) -> Signal:
    """Return it. Raises LoopError where files give other values for the same times, which other signals may not."""
    try:
        signal.times.order(signal.values)
    except LoopError as error:
        if error.code == "files_differ":
            raise LoopError(error.what, where=tag, remedy=error.remedy, code=error.code) from None
    return signal


def add_faults(total: Faults, found: Faults) -> list[Note]:
    """Add what was counted to a total; return what is to be said of these kinds of faults."""
    notes = []
    for (code, tag), words in found.items():
        (all_words := total.setdefault((code, tag), Counter())).update(words)
        if count := all_words.total():
            top = some([f"{word or '(blank)'} ({number})" for word, number in all_words.most_common()], 4)
            effect = {"effect": "blocks"} if code in ("unit_change", "points_lost") else {}  # two sizes, none right
            notes.append(noted(code, {"samples": float(count), **effect}, tag=tag[:60], top=top))
    return notes


def one_per_file(series: list[Series], role: str) -> tuple[list[Series], list[Note]]:
    """Return the one of each file that is named most like a role, and what is said of others. Raises LoopError."""
    notes, groups, chosen = list[Note](), defaultdict[str, list[Series]](list), list[Series]()
    for item in series:
        groups[item.axis.where].append(item)
    for where, items in groups.items():
        ranks = [([*SIGNALS.get(role, "").split(), w := plain(s.signal)].index(w),  # FIC101.PV before FIC101.PV.MAX
                  len(s.tag) > len(s.loop) + len(s.signal) + 1) for s in items] if items[1:] else [(0, False)]
        first = [item for item, rank in zip(items, ranks, strict=True) if rank == min(ranks)]
        if len(first) < len(items):
            names = some([item.tag for item in items])
            notes.append(noted("several_columns", names=names, role=role.upper(), tag=first[0].tag))
        if len(first) > 1 and first[0].axis is first[1].axis:
            values, *others = (item.cells().numbers()[0] for item in first)
            if not all(np.array_equal(values, other, equal_nan=True) for other in others):
                raise LoopError(**explained("duplicate_columns", count=len(first), tag=first[0].tag), where=where)
            notes.append(noted("duplicate_columns", tag=first[0].tag, count=len(first)))
            first = first[:1]
        chosen += first
    return chosen, notes
