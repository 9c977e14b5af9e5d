"""Quality words and codes, and controller modes: which samples count."""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from ..record import FloatArray, IntArray, Note
from .numbers import parse_words
from .signals import Cells

_GOOD = re.compile(r"^\s*(?:good|ok|gut|bon|valid|raw|normal|true|g|0xc0|0x000000c0|good[ ,(/:_\-].*)\s*$",
                   re.IGNORECASE)
_BAD = re.compile(r"^\s*(?:bad|uncertain|questionable|invalid|not ?good|schlecht|ungültig|false|b|u|0x0+|error|fail\w*|"
                  r"(?:bad|uncertain)[ ,(/:_\-].*)\s*$", re.IGNORECASE)
_DOUBT = re.compile(r"bad|uncertain|substitut|last ?(?:usable|known)|stale", re.IGNORECASE)
_ONE_IS_GOOD = re.compile(r"^(?!.*(?:inv|bad|not|un)).*(?:valid|good|gültig|gueltig)", re.IGNORECASE)
_AUTO = re.compile(r"^(?:aut.*|a|cas.*|kas.*|c|r-?cas.*|remote.*|rsp|ext.*|r|bcas.*|b-?cas.*|on|true|prog.*|sup.*|"
                   r"normal|closed.*|[123](?:\.0*)?)$", re.IGNORECASE)
_MANUAL = re.compile(r"^(?:man.*|m|hand.*|h|lo|local.*|i-?man.*|iman.*|init.*|tr.*|oos|out.?of.?serv.*|rout|r-?out|"
                     r"off|false|bman|force.*|hold|open.*|stop.*|0(?:\.0*)?)$", re.IGNORECASE)


def quality_words(words: list[str]) -> bool:
    """Say whether texts are qualities, and no modes or states."""
    plain = [word for word in words if len(word.strip()) > 1]
    return bool(plain) and all(_GOOD.match(word) or _BAD.match(word) for word in plain) and any(
        re.match(r"\s*(?:good|bad|gut|uncertain|0xc0)", word, re.IGNORECASE) for word in plain)


def _numbers_or_words(cells: Cells, *, all_texts: bool) -> tuple[FloatArray | None, IntArray, list[str]]:
    """Return (numbers, codes, words): the cells as numbers, None where their texts are something else.

    All texts have to be numbers, or only those that are not digital states.
    """
    if not cells.is_text:
        return cells.values, np.zeros(0, np.int64), []
    codes, words = cells.texts()
    values, bad, _ = parse_words(words)
    numbers = (np.isfinite(values) if all_texts else np.isfinite(values) | bad).all() and not bad.all()
    return np.append(values, np.nan)[codes] if numbers else None, codes, words


def good_samples(cells: Cells, further: tuple[str, ...], name: str = "", known: dict[str, float] | None = None
                 ) -> tuple[NDArray[np.bool_], list[Note]]:
    """Return (rows,) True where the quality says good. Numbers are OPC codes (192 and more), percents or 0/1.

    further: words or numbers that mean good. name: of the column; Validity and its like are 1 where the row is good.
    known: what the chunks of a loop before this one tell of its numbers; it is added to.
    """
    numbers, codes, words = _numbers_or_words(cells, all_texts=True)
    if numbers is not None:
        return _good_numbers(numbers, further, name, {} if known is None else known)
    extra = {word.strip().lower() for word in further}
    good = [word.strip().lower() in extra or (bool(_GOOD.match(word)) and not _DOUBT.search(word)) for word in words]
    if not any(good):  # only faults are marked: an empty cell is good
        note = Note("quality_words", f"no quality reads Good; rows marked {_some(words)} are dropped")
        return np.append(np.array(good, bool), True)[codes], [note]
    # a change-driven quality column leaves unchanged rows empty, the last word holds
    codes = codes[np.maximum.accumulate(np.where(codes >= 0, np.arange(len(codes)), 0))]
    return np.append(np.array(good, bool), False)[codes], []


def _good_numbers(values: FloatArray, further: tuple[str, ...], name: str, seen: dict[str, float]
                  ) -> tuple[NDArray[np.bool_], list[Note]]:
    wanted = [float(word) for word in further if re.fullmatch(r"\d+(?:\.\d+)?", word)]
    known = values[np.isfinite(values)]
    if wanted or not len(known):
        return np.isin(values, wanted) if wanted else np.ones(len(values), bool), []
    low = seen["low"] = min(seen.get("low", np.inf), float(known.min()))
    high = seen["high"] = max(seen.get("high", -np.inf), float(known.max()))
    usual = seen.setdefault("usual", float(np.median(known)))
    if high >= 1 << 30:  # OPC UA status codes: the two highest bits are the severity
        return values < 1 << 30, []
    if high >= 192:
        return (values >= 192) & (values < 256), []
    if high == 100 or (_ONE_IS_GOOD.search(name) and low >= 0.0 and high <= 1.0):
        return values == (100.0 if high == 100 else 1.0), []
    if low == high and usual not in (0.0, 1.0):
        return np.zeros(len(values), bool), []
    notes = [] if low == high else [Note(
        "quality_code", f"quality numbers are not OPC codes; {usual:g}, the most frequent, is taken as good "
        "(--good-quality names others)")]
    return values == usual, notes


def automatic(cells: Cells, further: tuple[str, ...]) -> tuple[FloatArray, list[Note]]:
    """Return (rows,) 1 where the controller was in automatic (or cascade), 0 where not, nan where not recorded.

    Numbers: 0 manual and 1, 2, 3 automatic or cascade; powers of two from 16 on as in Foundation Fieldbus.
    """
    extra = {word.strip().lower() for word in further}
    numbers, codes, words = _numbers_or_words(cells, all_texts=False)
    if numbers is not None:
        return _auto_numbers(numbers, extra)
    texts = [word.strip().lower() for word in words]
    auto = [text in extra or bool(_AUTO.match(text)) for text in texts]
    unknown = [word.strip() for word, text, yes in zip(words, texts, auto, strict=True)
               if text and not yes and not _MANUAL.match(text)]
    notes = [Note("mode_words", f"modes {_some(unknown)} are not known and count as not automatic (auto_modes in "
                  "loops.toml names further ones)")] if unknown else []
    states = [float(yes) if text else np.nan for text, yes in zip(texts, auto, strict=True)]
    return np.array([*states, np.nan])[codes], notes


def _auto_numbers(values: FloatArray, extra: set[str]) -> tuple[FloatArray, list[Note]]:
    present = np.isfinite(values)
    distinct = np.unique(values[present])
    named = [float(w) for w in extra if re.fullmatch(r"-?\d+(?:\.\d+)?", w)]
    whole, notes = np.clip(distinct, 0, 256).astype(np.int64), []
    if named:
        auto = np.isin(values, named)
    elif np.isin(distinct, (0.0, 1.0, 2.0, 3.0)).all():
        auto = values >= 1
    elif np.all((distinct == whole) & (whole > 0) & (whole <= 128) & (whole & (whole - 1) == 0)):
        auto = np.isin(values, (16.0, 32.0, 64.0))
        notes = [Note("mode_numbers", "modes are read as fieldbus numbers: 16, 32 and 64 are automatic")]
    else:
        auto = values == 1
        shown = ", ".join(f"{v:g}" for v in distinct[:5])
        notes = [Note("mode_numbers", f"modes {shown} are not all known; only 1 counts as automatic (auto_modes in "
                      "loops.toml names others)")]
    return np.where(present, auto, np.nan), notes


def _some(words: list[str]) -> str:
    shown = ", ".join(w.strip()[:20] or "(blank)" for w in words[:4])
    return shown + (", ..." if len(words) > 4 else "")
