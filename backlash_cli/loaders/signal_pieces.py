"""One signal of a long record over all files, read anew some rows at a time: what `Joiner.signal` gives of it whole."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..record import Note
from .join import bad_quality, each_once, not_numbers
from .numbers import as_texts, parse_words
from .pieces import NotInPieces, RawColumn, in_step, raw_column, stamp_parts
from .quality import automatic, good_numbers, good_words, last_word
from .series import Axis, Cells, Lexicon, Series
from .stored_columns import WordReading, word_codes, word_counts

BAD = np.array([0x7FF8_BAD0_0000_0000]).view(np.float64)[0]  # a nan that stands where something was no good measurement
MOST_DISTINCT = 10_000  # different numbers in a column of modes or qualities
Stream = Callable[[], Iterator[NDArray[np.float64]]]


def is_bad(values: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(rows,) True where something stood that is no good measurement."""
    return values.view(np.int64) == BAD.view(np.int64)


@dataclass(frozen=True, eq=False)
class PieceSignal:
    """A signal in pieces. axes: of its parts, in time order. values: gives all rows anew, nan where blank, BAD where
    something else stood. notes: what Joiner says of it. spoilt: something else stood in rows that were left out.
    """

    axes: tuple[Axis, ...]
    values: Stream
    notes: tuple[Note, ...] = ()
    apart: bool = False  # its rows are not taken as those of any other signal
    spoilt: bool = False

    def beside(self, other: PieceSignal) -> bool:
        """Whether two signals stand in the same rows."""
        return not (self.apart or other.apart) and list(map(id, self.axes)) == list(map(id, other.axes))

    def stamps(self) -> Iterator[NDArray[np.int64]]:
        """Yield the stamps of all rows [microseconds since 1970 UTC]."""
        return (part for axis in self.axes for part in stamp_parts(axis))

    def rows(self) -> Iterator[tuple[NDArray[np.int64], NDArray[np.float64]]]:
        """Yield stamps and values, some rows at a time."""
        return ((stamps, values) for stamps, values in in_step([self.stamps(), self.values()]))


def measured_signal(series: Sequence[Series], further: tuple[str, ...]) -> PieceSignal:
    """Return a signal of numbers. further: words of good quality. Raises NotInPieces where it must be seen whole."""
    _one_per_file(series)
    parts = sorted(((_first_stamp(item.axis), k, _part(item, further)) for k, item in enumerate(series)),
                   key=lambda part: part[:2])
    found = [part for _, _, part in parts]
    notes = found[0].notes if len(found) == 1 else each_once(note for part in found for note in part.notes)
    return PieceSignal(tuple(series[k].axis for _, k, _ in parts),
                       lambda: (values for part in found for values in part.values()), notes)


def mode_signal(series: Sequence[Series], auto_modes: tuple[str, ...]) -> PieceSignal:
    """Return 1 where a controller was in automatic, 0 where not. Raises NotInPieces where it must be seen whole."""
    found = []
    notes: list[Note] = []
    in_order = sorted(series, key=lambda item: _first_stamp(item.axis))
    for item in series:
        coded = _coded(raw_column(item.cells))
        cells = Cells(values=coded.numbers)
        if coded.raw.text:
            cells = Cells(codes=np.arange(len(coded.words)), lexicon=Lexicon(coded.words, item.cells.decimal))
        states, more = automatic(cells, auto_modes)
        notes += more
        found.append((coded, np.append(states, np.nan)))
    turned = [found[series.index(item)] for item in in_order]
    return PieceSignal(tuple(item.axis for item in in_order),
                       lambda: (table[codes] for coded, table in turned for codes in coded.codes()), tuple(notes),
                       apart=in_order != list(series))


@dataclass(frozen=True)
class _Part:
    values: Stream
    notes: tuple[Note, ...] = ()


def _one_per_file(series: Sequence[Series]) -> None:
    if len({item.where for item in series}) < len(series):
        raise NotInPieces


def _first_stamp(axis: Axis) -> int:
    return int(next(stamp_parts(axis), np.zeros(1, np.int64))[0])


def _part(item: Series, further: tuple[str, ...]) -> _Part:
    """The numbers of one file."""
    raw = raw_column(item.cells)
    notes: list[Note] = []
    values: Stream = raw.parts
    if raw.text:
        counts = np.zeros(0, np.int64)
        for part in raw.parts():
            counts = _counted(counts, part, raw)
        reading = WordReading(raw.words(), counts, raw.decimal)
        if reading.tally:
            notes.append(not_numbers(reading.tally, item.tag))
        values = lambda: (_with_bad(*reading.apply(part)) for part in raw.parts())  # noqa: E731
    if item.quality is None:
        return _Part(values, tuple(notes))
    good, on_quality = _quality(raw_column(item.quality), further)
    dropped = sum(int(np.count_nonzero(~flags)) for flags in good())
    notes += [*on_quality, *([bad_quality(dropped, item.tag)] if dropped else [])]
    plain = values
    if dropped:
        values = lambda: (np.where(flags, numbers, BAD)  # noqa: E731
                          for numbers, flags in in_step([plain(), good()]))
    return _Part(values, tuple(notes))


def _counted(counts: NDArray[np.int64], values: NDArray[np.float64], raw: RawColumn) -> NDArray[np.int64]:
    """Add how often each word occurs in some cells to the counts so far; words may be new."""
    found = word_counts(values, len(raw.words()))
    found[: len(counts)] += counts
    return found


def _with_bad(values: NDArray[np.float64], bad: NDArray[np.bool_]) -> NDArray[np.float64]:
    values[bad] = BAD
    return values


@dataclass
class _Coded:
    """A column of few different cells. words: its texts by code, of numbers too if it is text. counts: of each."""

    raw: RawColumn
    numbers: NDArray[np.float64]
    words: list[str] = field(default_factory=list)
    counts: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    places: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))  # of stored words in `words`

    def codes(self) -> Iterator[NDArray[np.int64]]:
        """Yield the code of each cell, -1 for an empty one."""
        first = len(self.words) - len(self.numbers) if self.raw.text else 0
        for values in self.raw.parts():
            out = np.append(self.places, -1)[word_codes(values)] if self.raw.text else np.full(len(values), -1)
            number = ~np.isnan(values)
            out[number] = first + np.searchsorted(self.numbers, values[number])
            yield out


def _coded(raw: RawColumn) -> _Coded:
    numbers, of_numbers = np.zeros(0), np.zeros(0, np.int64)
    of_words = np.zeros(0, np.int64)
    for values in raw.parts():
        found, counts = np.unique(values[~np.isnan(values)], return_counts=True)
        numbers, place = np.unique(np.concatenate([numbers, found]), return_inverse=True)
        of_numbers = np.bincount(place, np.concatenate([of_numbers, counts]), len(numbers)).astype(np.int64)
        if len(numbers) > MOST_DISTINCT:
            raise NotInPieces
        if raw.text:
            of_words = _counted(of_words, values, raw)
    there = np.flatnonzero(of_words)
    places = np.full(len(of_words), -1)
    places[there] = np.arange(len(there))
    words = [raw.words()[i] for i in there]
    if raw.text:
        words += as_texts(numbers)
    return _Coded(raw, numbers, words, np.concatenate([of_words[there], of_numbers]), places)


def _quality(
    raw: RawColumn, further: tuple[str, ...]
) -> tuple[Callable[[], Iterator[NDArray[np.bool_]]], list[Note]]:
    """Return what gives which rows are good, and what is to be said of it; as `good_samples` does."""
    coded = _coded(raw)
    notes: list[Note] = []
    values = parse_words(coded.words)[0] if raw.text else coded.numbers
    if not raw.text or (coded.words and np.isfinite(values).all()):
        good = good_numbers(_ends(values, coded.counts), further, notes)(np.append(values, np.nan))
        return lambda: (good[codes] for codes in coded.codes()), notes
    flags, blank_is_good = good_words(coded.words, further, notes)
    table = np.append(flags, blank_is_good)

    def rows() -> Iterator[NDArray[np.bool_]]:
        last = np.full(1, -1)
        for codes in coded.codes():
            if not blank_is_good:
                codes = last_word(np.concatenate([last, codes]))[1:]
                last = codes[-1:] if len(codes) else last
            yield table[codes]

    return rows, notes


def _ends(values: NDArray[np.float64], counts: NDArray[np.int64]) -> tuple[float, float, float] | None:
    """Return (least, greatest, median) of finite values that occur so many times each."""
    turn = np.argsort(values)
    values, counts = values[turn], counts[turn]
    counts = np.where(np.isfinite(values), counts, 0)
    total, below = int(counts.sum()), np.cumsum(counts)
    if not total:
        return None
    middle = values[np.searchsorted(below, [(total - 1) // 2, total // 2], side="right")]
    there = values[counts > 0]
    return float(there[0]), float(there[-1]), float(middle.mean())
