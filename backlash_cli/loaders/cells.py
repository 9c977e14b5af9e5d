"""Cells of a column: numbers with thousands separators and units, digital states and words for "not a number"."""

import re
from collections import Counter
from dataclasses import field, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from ..record import BoolArray, FloatArray, Frozen, IntArray
from .names import FORM

BLANK = frozenset(["null", "NULL", "Null", "None", "NA", "N/A", "n/a"])  # words for an empty cell


class Lexicon(Frozen, eq=False):
    """Texts that stand in a column, by their numbers; read as numbers once for all that share them."""

    words: list[str] = field(default_factory=list)
    decimal: str = "."

    @cached_property
    def parsed(self) -> tuple[FloatArray, BoolArray, list[str]]:
        """(values, bad, units) of the texts; blank text is nan and not bad."""
        values, units = plain_numbers(self.words, self.decimal), [""] * len(self.words)
        rest = np.flatnonzero(np.isnan(values)).tolist()
        comma = decimal_sign([self.words[i] for i in rest[:5000]], self.decimal) == ","
        for i in rest:
            values[i], units[i] = _with_unit(self.words[i].strip().lstrip("'"), comma)
        return values, np.isnan(values) & np.array([bool(word.strip()) for word in self.words], bool), units


class Cells(Frozen, eq=False):
    """Cells of a column. values: (rows,) nan where no number stands. codes: (rows,) place in the lexicon or -1."""

    values: FloatArray
    codes: NDArray[np.int32] | None = None
    lexicon: Lexicon = field(default_factory=Lexicon)

    def __getitem__(self, rows: slice | IntArray) -> Self:
        return replace(self, values=self.values[rows], codes=None if self.codes is None else self.codes[rows])

    @cached_property
    def _used(self) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
        """(places in the lexicon of the texts that occur, rows that hold one, its place among those)"""
        codes = np.zeros(0, int) if self.codes is None else self.codes
        rows = np.flatnonzero(codes >= 0)
        used, which = np.unique(codes[rows], return_inverse=True)
        return used, rows, which

    @property
    def is_text(self) -> bool:
        return self.codes is not None and len(self._used[0]) > 0

    def numbers(self) -> tuple[FloatArray, BoolArray]:
        """Return (values, bad): the cells as numbers, nan where blank or bad: a word, inf, another unit than most."""
        flags = np.isinf(self.values)
        if not self.is_text:
            return self.values, flags
        (used, rows, which), (values, bad, all_units) = self._used, self.lexicon.parsed
        units, tally = [all_units[i].lower() for i in used], Counter[str]()
        for unit, count in zip(units, np.bincount(which).tolist(), strict=True):
            tally[unit] += count * bool(unit)
        plain = int(np.count_nonzero(np.isfinite(self.values)))
        # a unit stands behind all numbers, or nearly; behind some of them it says that these are other ones
        main = "" if 4 * plain > tally.total() or (plain and tally.keys() & {"k", "m"}) else tally.most_common(1)[0][0]
        flags[rows] = (bad[used] | [unit not in ("", main) for unit in units])[which]
        out = np.where(flags, np.nan, self.values)
        out[rows] = np.where(flags[rows], np.nan, values[used][which])
        return out, flags

    def words(self, rows: BoolArray, within: slice) -> Counter[str]:
        """Count the texts in rows that are True, of some rows in a row."""
        codes = np.zeros(0, int) if self.codes is None else self.codes[within][rows[within]]
        return Counter(self.lexicon.words[code].strip()[:40] for code in codes[codes >= 0].tolist())

    def texts(self) -> tuple[IntArray, list[str]]:
        """Return (codes, words): the text of each cell, of numbers too, whole ones without a point; -1 if empty."""
        (used, rows, which), codes = self._used, np.full(len(self.values), -1)
        codes[rows] = which
        known = np.flatnonzero(~np.isnan(self.values) & (codes < 0))
        values, which = np.unique(self.values[known], return_inverse=True)
        codes[known] = which + len(used)
        numbers = (f"{v:.0f}" if v == np.rint(v) and abs(v) < 1e15 else repr(v) for v in values.tolist())
        return codes, [*(self.lexicon.words[i] for i in used), *numbers]


def is_number(kind: pa.DataType) -> bool:
    return pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_decimal(kind)


def is_text(kind: pa.DataType) -> bool:
    return any(is_kind(kind) for is_kind in (pa.types.is_string, pa.types.is_large_string, pa.types.is_string_view,
                                             pa.types.is_dictionary, pa.types.is_binary, pa.types.is_large_binary))


def to_array(column: pa.ChunkedArray | pa.Array) -> NDArray[Any]:
    """Return the cells (rows,) of a column of numbers: nan where a cell is empty, also of whole numbers."""
    if isinstance(column, pa.ChunkedArray):  # of one piece: combined it would be copied
        column = column.chunk(0) if column.num_chunks == 1 else column.combine_chunks()
    if column.null_count or not (pa.types.is_integer(column.type) or pa.types.is_floating(column.type)):
        return column.to_numpy(zero_copy_only=False)
    return np.from_dlpack(column)  # without a load of pandas, which takes longer than a loop to read


def stored(column: pa.ChunkedArray | pa.Array, words: dict[str, int], decimal: str = ".", *, written: bool = False
           ) -> tuple[FloatArray, NDArray[np.int32] | None]:
    """Return (values, codes) of a column: (rows,) its numbers, or nan, and places in `words` of texts that are no plain
    numbers, None where there are none. written: read from text, where nan and inf stand for no empty cell."""
    kind = column.type
    if is_number(kind) or pa.types.is_boolean(kind) or pa.types.is_null(kind):
        values = to_array(column if pa.types.is_float64(kind) else column.cast(pa.float64(), safe=False))
        if not written or np.count_nonzero(odd := ~np.isfinite(values)) <= column.null_count:
            return values, None
        odd &= to_array(column.is_valid())
        marks = np.full(len(values), -1, np.int32)
        marks[odd] = [words.setdefault(str(value), len(words)) for value in values[odd].tolist()]
        return np.where(odd, np.nan, values), marks
    codes, texts = codes_and_words(column if is_text(kind) else pa.array([str(kind)] * len(column)))
    values, found = plain_numbers(texts, decimal), np.full(len(texts) + 1, -1, np.int32)
    for i in np.flatnonzero(np.isnan(values) & (np.bincount(codes + 1, minlength=len(texts) + 1)[1:] > 0)).tolist():
        found[i] = words.setdefault(texts[i], len(words))
    own = found[codes]
    return np.append(values, np.nan)[codes], own if (own >= 0).any() else None


def codes_and_words(column: pa.ChunkedArray | pa.Array) -> tuple[IntArray, list[str]]:
    """Return (codes, words) of a text column: codes[i] is -1 for an empty cell, else a position in words."""
    column = column if pa.types.is_dictionary(column.type) else column.dictionary_encode()
    if isinstance(column, pa.ChunkedArray):
        column = column.unify_dictionaries().combine_chunks()
    indices, found = column.indices, column.dictionary
    indices = to_array(indices.fill_null(-1) if indices.null_count else indices).astype(np.int64)
    found = found if is_text(found.type) else found.cast(pa.large_string())
    # as bytes: in a damaged Parquet file they may be no text
    texts = [(word or b"").decode(errors="replace") for word in found.cast(pa.large_binary()).to_pylist()]
    keep = np.array([bool(text) and text not in BLANK and not text.isspace() for text in texts] + [False])
    return (indices if keep[:-1].all() else np.where(keep[indices], indices, -1)), texts


def plain_numbers(words: list[str], decimal: str = ".") -> FloatArray:
    """Return the values of the texts that are plain finite numbers, nan for all others."""
    text = pc.utf8_trim_whitespace(pa.array(words, pa.large_string()))
    chosen = pc.match_substring_regex(text, FORM.plain.pattern.replace(r"\.", f"[{decimal}]"))
    plain = pc.replace_substring(pc.if_else(chosen, text, None), decimal, ".")
    values = to_array(pc.utf8_ltrim(plain, "+").cast(pa.float64()))
    return np.where(np.isinf(values), np.nan, values)


def _with_unit(text: str, comma: bool) -> tuple[float, str]:
    """The number and the unit of a text, nan for one that is no good number. comma: is its decimal sign."""
    text = text.replace("\u2212", "-")
    minus = re.fullmatch(r"\(([^()]+)\)|([^-].*?) *-", text) if len(text) <= 60 else None  # as (12.5) and 12.5-
    text = f"-{minus[1] or minus[2]}" if minus else text
    match = None if len(text) > 60 or FORM.clock.match(text) else FORM.united.match(text)
    unit = (match[2] or "").strip() if match else ""
    if match is None or FORM.flag.search(unit):
        return np.nan, ""
    digits = match[1].lower().replace("d", "e").translate({44: ".", 46: ","} if comma else {})
    try:
        value = float(FORM.separator.sub("", digits) if FORM.grouped.match(digits) else digits)
    except ValueError:
        value = np.nan
    return (value, unit) if np.isfinite(value) else (np.nan, "")


def decimal_sign(words: list[str], decimal: str) -> str:
    """The decimal sign of texts: the given one, unless more of them show the other one where it parts no thousands."""
    words, other = [FORM.blank.sub("", w) for w in words], "," if decimal == "." else "."
    if both := next((w for w in words if "." in w and "," in w), ""):
        return "," if both.rfind(",") > both.rfind(".") else "."
    if any(w.count(",") > 1 for w in words):
        return "."
    shown = [w for w in words if not re.match(r"[+-]?[1-9]\d{0,2}([.,]\d{3})+(?!\d)", w)]
    count, against = (sum(bool(re.match(rf"[+-]?\d+[{c}]\d+(?![.\d])", w)) for w in shown) for c in (decimal, other))
    return other if against > count else decimal
