"""Cells to numbers: thousands separators, units, digital states and words for "not a number"."""

from __future__ import annotations

import re
from collections import Counter
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from ..record import FloatArray, IntArray

BLANK = frozenset(["null", "NULL", "Null", "None", "NA", "N/A", "#N/A", "n/a"])  # words for an empty cell
_NUMBER = r"^[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?$"
_UNITED = re.compile(r"^([+-]?(?:\d[\d.,'’ \u00a0\u202f]*\d|\d|[.,]\d+)(?:[eE][+-]?\d+)?)\s*([^\d\s].*)?$", re.DOTALL)
# With the point as decimal sign: groups of three digits between separators, all of one kind.
_GROUPED = re.compile(r"^[+-]?\d{1,3}(?:([,'’ \u00a0\u202f])\d{3})(?:\1\d{3})*(?:\.\d*)?(?:[eE][+-]?\d+)?$")
_SEPARATED = re.compile(r"[,'’ \u00a0\u202f]")
_BLANKS = re.compile(r"[\s'’\u00a0\u202f]")
_SWAP = str.maketrans(",.", ".,")
_FLAG = re.compile(r"\b(?:bad|uncertain|questionable|suspect|invalid|error|fail\w*|stale|timeout)\b|^[?#*]+$"
                   r"|^\.?#(?:INF|\w*NAN|IND)", re.IGNORECASE)  # behind a number: it is none (1.#QNAN)
_CLOCK = re.compile(r"^\d+[:/-]\d")  # a time or a date is no measurement


def is_number(kind: pa.DataType) -> bool:
    """Say whether a type holds numbers."""
    return pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_decimal(kind)


def is_text(kind: pa.DataType) -> bool:
    """Say whether a type holds texts."""
    return pa.types.is_string(kind) or pa.types.is_large_string(kind) or pa.types.is_dictionary(kind)


def to_array(column: pa.ChunkedArray | pa.Array) -> NDArray[Any]:
    """Return the cells (rows,) of a column of numbers: nan where a cell is empty, also of whole numbers."""
    return column.to_numpy(zero_copy_only=False)


def stored(column: pa.ChunkedArray | pa.Array, words: dict[str, int], decimal: str = ".", *, written: bool = False
           ) -> tuple[FloatArray, NDArray[np.int32] | None]:
    """Return (values, codes) of a column of any type: its numbers, nan where there are none, and the places in `words`
    of the texts that are no plain numbers, None where there are none. New texts are added to `words`.

    written: the column was read from text, where nan and inf stand for something else than an empty cell.
    """
    kind = column.type
    if pa.types.is_null(kind):
        return np.full(len(column), np.nan), None
    if is_number(kind) or pa.types.is_boolean(kind):
        values = to_array(column if pa.types.is_float64(kind) else column.cast(pa.float64(), safe=False))
        odd = ~np.isfinite(values) if written and pa.types.is_float64(kind) else np.zeros(0, bool)
        if np.count_nonzero(odd) <= column.null_count:
            return values, None
        odd &= to_array(column.is_valid())
        marks = np.full(len(values), -1, np.int32)
        marks[odd] = [words.setdefault(str(value), len(words)) for value in values[odd].tolist()]
        return np.where(odd, np.nan, values), marks
    as_text = is_text(kind) or pa.types.is_binary(kind) or pa.types.is_large_binary(kind)
    codes, texts = codes_and_words(column if as_text else pa.array([str(kind)] * len(column)))
    values = plain_numbers(texts, decimal)
    there, found = np.zeros(len(texts) + 1, bool), np.full(len(texts) + 1, -1, np.int32)
    there[codes] = True
    for i in np.flatnonzero(np.isnan(values) & there[:-1]).tolist():
        found[i] = words.setdefault(texts[i], len(words))
    own = found[codes]
    return np.append(values, np.nan)[codes], own if (own >= 0).any() else None


def codes_and_words(column: pa.ChunkedArray | pa.Array) -> tuple[IntArray, list[str]]:
    """Return (codes, words) of a text column: codes[i] is -1 for an empty cell, else a position in words."""
    column = column if pa.types.is_dictionary(column.type) else column.dictionary_encode()
    if isinstance(column, pa.ChunkedArray):
        column = column.unify_dictionaries().combine_chunks()
    indices, found = to_array(column.indices.fill_null(-1)).astype(np.int64), column.dictionary
    found = found if is_text(found.type) or pa.types.is_binary(found.type) else found.cast(pa.large_string())
    # as bytes: in a damaged Parquet file they may be no text
    texts = [(word or b"").decode(errors="replace") for word in found.cast(pa.large_binary()).to_pylist()]
    keep = np.array([bool(text) and text not in BLANK and not text.isspace() for text in texts] + [False])
    return (indices if keep[:-1].all() else np.where(keep[indices], indices, -1)), texts


def plain_numbers(words: list[str], decimal: str = ".") -> FloatArray:
    """Return the values of the texts that are plain finite numbers, nan for all others."""
    values = np.full(len(words), np.nan)
    if not words:
        return values
    text = pc.utf8_trim_whitespace(pa.array(words, pa.large_string()))
    if decimal != ".":
        text = pc.replace_substring(text, decimal, ".")
    chosen = pc.match_substring_regex(text, _NUMBER)
    values[to_array(chosen)] = to_array(pc.utf8_ltrim(text.filter(chosen), "+").cast(pa.float64()))
    values[np.isinf(values)] = np.nan
    return values


def parse_words(words: list[str], decimal: str = ".") -> tuple[FloatArray, NDArray[np.bool_], list[str]]:
    """Return (values, bad, units) of distinct texts. Blank text gives nan and is not bad."""
    values = plain_numbers(words) if decimal == "." else np.full(len(words), np.nan)
    units = [""] * len(words)
    rest = np.flatnonzero(np.isnan(values)).tolist()
    comma = "," in (decimal, _decimal_sign([words[i] for i in rest[:5000]], decimal))
    for i in rest:
        values[i], units[i] = _with_unit(words[i].strip(), comma)
    return values, np.isnan(values) & np.array([bool(word.strip()) for word in words], bool), units


def _with_unit(text: str, comma: bool) -> tuple[float, str]:
    """The number and the unit of a text, nan for one that is no good number. comma: is its decimal sign."""
    match = None if len(text) > 60 or _CLOCK.match(text) else _UNITED.match(text)
    unit = (match[2] or "").strip() if match else ""
    if match is None or _FLAG.search(unit):
        return np.nan, ""
    digits = match[1].translate(_SWAP) if comma else match[1]
    if _GROUPED.match(digits):
        digits = _SEPARATED.sub("", digits)
    try:
        value = float(digits)
    except ValueError:
        value = np.nan
    return (value, unit) if np.isfinite(value) else (np.nan, "")


def _decimal_sign(words: list[str], decimal: str) -> str:
    """The decimal sign that the texts themselves show: "," only when a comma cannot be a thousands separator."""
    words = [_BLANKS.sub("", w) for w in words]
    for digits in words:
        if "." in digits and "," in digits:
            return "," if digits.rfind(",") > digits.rfind(".") else "."
    commas = [w for w in words if re.match(r"^[+-]?\d+,\d+", w)]
    grouped = [w for w in commas if re.match(r"^[+-]?[1-9]\d{0,2}(,\d{3})+(?!\d)", w)]
    return "," if commas and len(grouped) < len(commas) else decimal


def foreign_units(units: list[str], counts: IntArray) -> NDArray[np.bool_]:
    """(texts,) Which carry another unit than most cells do: they cannot be compared and count as bad."""
    tally: Counter[str] = Counter()
    for unit, count in zip(units, counts.tolist(), strict=True):
        tally[unit] += count * bool(unit)
    main = max(tally, key=lambda unit: tally[unit], default="")
    return np.array([bool(unit) and unit.lower() != main.lower() for unit in units], bool)
