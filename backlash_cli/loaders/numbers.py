"""Cells to numbers: thousands separators, units, digital states and words for "not a number"."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass, field

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from .arrays import to_array, to_column, to_texts, where_true

BLANK = frozenset(["null", "NULL", "Null", "None", "NA", "N/A", "#N/A", "n/a"])  # words for an empty cell
_NUMBER = r"^[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?$"
_UNITED = re.compile(r"^([+-]?(?:\d[\d.,'’ \u00a0\u202f]*\d|\d|[.,]\d+)(?:[eE][+-]?\d+)?)\s*([^\d\s].*)?$", re.DOTALL)
# With the point as decimal sign: groups of three digits between separators, all of one kind.
_GROUPED = re.compile(r"^[+-]?\d{1,3}(?:([,'’ \u00a0\u202f])\d{3})(?:\1\d{3})*(?:\.\d*)?(?:[eE][+-]?\d+)?$")
_SEPARATED = re.compile(r"[,'’ \u00a0\u202f]")
_BLANKS = re.compile(r"[\s'’\u00a0\u202f]")
_SWAP = str.maketrans(",.", ".,")
_NOT_FINITE = re.compile(r"^[+-]?(?:inf(?:inity)?|nan|1\.#\w+|∞)$", re.IGNORECASE)
_FLAG = re.compile(r"\b(bad|uncertain|questionable|suspect|invalid|error|fail\w*|stale|timeout)\b", re.IGNORECASE)
_CLOCK = re.compile(r"^\d+[:/-]\d")  # a time or a date is no measurement
_SUBSTITUTED = re.compile(r"^[?#*]+$")


@dataclass(frozen=True)
class Numbers:
    """values: (rows,) float64, nan where there is none. bad: (rows,) True where something stood that is no good
    number (a digital state, inf), None when there is nothing of the kind; a blank cell is not bad.
    words: what stood there, counted. unit: the unit written behind the numbers."""

    values: NDArray[np.float64]
    bad: NDArray[np.bool_] | None = None
    words: Counter[str] = field(default_factory=Counter)
    unit: str = ""


def to_numbers(column: pa.ChunkedArray | pa.Array, decimal: str = ".") -> Numbers:
    """Convert one column of any type. Text that is no number is bad, and counted by its word."""
    kind = column.type
    if pa.types.is_floating(kind) or pa.types.is_integer(kind) or pa.types.is_boolean(kind):
        return _plain(_floats(column))
    if pa.types.is_null(kind):
        return Numbers(np.full(len(column), np.nan))
    if pa.types.is_decimal(kind):
        return _plain(_floats(column.cast(pa.float64())))
    if pa.types.is_dictionary(kind):
        return _coded(column, decimal)
    if pa.types.is_string(kind) or pa.types.is_large_string(kind):
        return _coded(column.dictionary_encode(), decimal)
    if pa.types.is_binary(kind) or pa.types.is_large_binary(kind):
        return _coded(_as_text(column).dictionary_encode(), decimal)
    return Numbers(np.full(len(column), np.nan), np.ones(len(column), bool), Counter({str(kind): len(column)}))


def codes_and_words(column: pa.ChunkedArray | pa.Array) -> tuple[NDArray[np.int64], list[str]]:
    """Return (codes, words) of a text column: codes[i] is -1 for an empty cell, else a position in words."""
    if not pa.types.is_dictionary(column.type):
        column = _as_text(column)
        column = column.dictionary_encode()
    if isinstance(column, pa.ChunkedArray):
        column = column.unify_dictionaries().combine_chunks()
        if isinstance(column, pa.ChunkedArray):  # no chunks at all
            return np.zeros(0, np.int64), []
    indices = to_array(column.indices)  # nan where a cell is empty
    indices = (np.where(np.isnan(indices), -1, indices) if column.indices.null_count else indices).astype(np.int64)
    words = _as_text(column.dictionary)
    texts = _decoded(words.fill_null("") if words.null_count else words)
    empty = [i for i, text in enumerate(texts) if not text or text in BLANK or text.isspace()]
    if empty:
        keep = np.ones(len(texts) + 1, bool)
        keep[empty] = False
        indices = np.where(keep[indices], indices, -1)
    return indices, texts


def words_that_occur(codes: NDArray[np.int64], words: list[str]) -> tuple[NDArray[np.int64], list[str]]:
    """Return the same texts with a list of only those words that stand somewhere."""
    there = np.flatnonzero(np.bincount(codes[codes >= 0], minlength=len(words)))
    place = np.full(len(words) + 1, -1)
    place[there] = np.arange(len(there))
    return place[codes], [words[i] for i in there]


def _decoded(words: pa.Array) -> list[str]:
    try:
        return words.to_pylist()
    except UnicodeDecodeError:  # a damaged Parquet file
        raw = words.cast(pa.large_binary() if pa.types.is_large_string(words.type) else pa.binary())
        return [word.decode("utf-8", errors="replace") for word in raw.to_pylist()]


def _as_text(column: pa.ChunkedArray | pa.Array) -> pa.ChunkedArray | pa.Array:
    """Any column as text; bytes that are no text become empty cells."""
    if pa.types.is_string(column.type) or pa.types.is_large_string(column.type):
        return column
    try:
        return column.cast(pa.string())
    except pa.ArrowException:
        return pa.nulls(len(column), pa.string())


def _plain(values: NDArray[np.float64]) -> Numbers:
    return Numbers(values)


def _floats(column: pa.ChunkedArray | pa.Array) -> NDArray[np.float64]:
    if not pa.types.is_float64(column.type):
        column = column.cast(pa.float64(), safe=False)
    return to_array(column)


def _coded(column: pa.ChunkedArray | pa.Array, decimal: str) -> Numbers:
    codes, words = codes_and_words(column)
    values, bad, units = parse_words(words, decimal)
    counts = np.bincount(codes[codes >= 0], minlength=len(words)) if len(words) else np.zeros(0, int)
    unit, foreign = main_unit(units, counts)
    bad |= foreign
    values[bad] = np.nan
    tally = Counter({words[i].strip()[:40]: int(counts[i]) for i in np.flatnonzero(bad) if counts[i]})
    table = np.append(values, np.nan)
    flags = np.append(bad, False)
    row_bad = flags[codes]
    return Numbers(table[codes], row_bad if row_bad.any() else None, tally, unit)


def parse_words(words: list[str], decimal: str = ".") -> tuple[NDArray[np.float64], NDArray[np.bool_], list[str]]:
    """Return (values, bad, units) of distinct texts. Blank text gives nan and is not bad."""
    array = to_texts(words)
    text = pc.utf8_trim_whitespace(array)
    values = np.full(len(words), np.nan)
    bad = np.zeros(len(words), bool)
    units = [""] * len(words)
    if decimal == ",":
        simple = np.zeros(len(words), bool)
    else:
        simple = where_true(pc.match_substring_regex(text, _NUMBER))
        if simple.any():
            chosen = np.flatnonzero(simple)
            plain = pc.replace_substring_regex(text.take(to_column(chosen, pa.int64())), r"^\+", "")
            values[chosen] = to_array(plain.cast(pa.float64()))
            bad |= np.isinf(values)
            values[bad] = np.nan
    rest = np.flatnonzero(~simple)
    if len(rest):
        mark = _thousands_mark([words[i] for i in rest[:5000]], decimal)
        for i in rest:
            values[i], bad[i], units[i] = _parse_word(words[i].strip(), decimal, mark)
    return values, bad, units


def as_texts(values: NDArray[np.float64]) -> list[str]:
    """Return finite numbers as texts, whole ones without a point."""
    return [f"{v:.0f}" if v == np.rint(v) and abs(v) < 1e15 else repr(v) for v in values.tolist()]


def plain_numbers(words: pa.Array, decimal: str = ".") -> NDArray[np.float64]:
    """Return the values of the texts that are plain finite numbers, nan for all others."""
    text = pc.utf8_trim_whitespace(words)
    if decimal != ".":
        text = pc.replace_substring(text, decimal, ".")
    chosen = np.flatnonzero(where_true(pc.match_substring_regex(text, _NUMBER)))
    values = np.full(len(words), np.nan)
    plain = pc.replace_substring_regex(text.take(to_column(chosen, pa.int64())), r"^\+", "")
    values[chosen] = to_array(plain.cast(pa.float64()))
    values[np.isinf(values)] = np.nan
    return values


def _parse_word(text: str, decimal: str, mark: str) -> tuple[float, bool, str]:
    if not text:
        return np.nan, False, ""
    if len(text) > 60:
        return np.nan, True, ""
    match = None if _NOT_FINITE.match(text) else _UNITED.match(text)
    if match is None or _CLOCK.match(text):
        return np.nan, True, ""
    unit = (match[2] or "").strip()
    if unit and (_FLAG.search(unit) or _SUBSTITUTED.match(unit)):
        return np.nan, True, ""
    digits = match[1]
    if decimal == "," or mark == ",":
        digits = digits.translate(_SWAP)
    if _SEPARATED.search(digits):
        if not _GROUPED.match(digits):
            return np.nan, True, ""
        digits = _SEPARATED.sub("", digits)
    try:
        value = float(digits)
    except ValueError:
        return np.nan, True, ""
    if not np.isfinite(value):
        return np.nan, True, ""
    return value, False, unit


def _thousands_mark(words: list[str], decimal: str) -> str:
    """Return the decimal sign that the texts themselves show: "," only when a comma cannot be a thousands separator."""
    words = [_BLANKS.sub("", w) for w in words]
    for digits in words:
        if "." in digits and "," in digits:
            return "," if digits.rfind(",") > digits.rfind(".") else "."
    commas = [w for w in words if re.match(r"^[+-]?\d+,\d+", w)]
    grouped = [w for w in commas if re.match(r"^[+-]?[1-9]\d{0,2}(,\d{3})+(?!\d)", w)]
    return "," if commas and len(grouped) < len(commas) else decimal


def main_unit(units: list[str], counts: NDArray[np.int64]) -> tuple[str, NDArray[np.bool_]]:
    """The unit most cells carry, and which texts carry another one (they cannot be compared and count as bad)."""
    tally: Counter[str] = Counter()
    for unit, count in zip(units, counts, strict=True):
        if unit:
            tally[unit] += int(count)
    if not tally:
        return "", np.zeros(len(units), bool)
    main = tally.most_common(1)[0][0]
    return main, np.array([bool(unit) and unit.lower() != main.lower() for unit in units], bool)
