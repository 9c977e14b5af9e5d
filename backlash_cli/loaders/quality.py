"""Quality words and codes, and controller modes: which samples count."""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from ..record import FloatArray, Note
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


def good_samples(cells: Cells, further: tuple[str, ...], name: str = "", known: dict[str, float] | None = None
                 ) -> tuple[NDArray[np.bool_], list[Note]]:
    """Return (rows,) True where the quality says good. Numbers are OPC codes (192 and more), percents or 0/1.

    further: words or numbers that mean good. name: of the column; Validity and its like are 1 where the row is good.
    known: what the chunks of a loop before this one tell of its numbers; it is added to.
    """
    notes: list[Note] = []
    known = {} if known is None else known
    if not cells.is_text:
        return _good_numbers(cells.values, further, name, notes, known), notes
    codes, words = cells.texts()
    values, _, _ = parse_words(words)
    if words and np.isfinite(values).all():
        return _good_numbers(np.append(values, np.nan)[codes], further, name, notes, known), notes
    extra = {word.strip().lower() for word in further}
    good = [word.strip().lower() in extra or (bool(_GOOD.match(word)) and not _DOUBT.search(word)) for word in words]
    only_faults = not any(good)  # only faults are marked: an empty cell is good
    if only_faults and words:
        notes.append(Note("quality_words", f"no quality reads Good; rows marked {_some(words)} are dropped"))
    if not only_faults and codes.min(initial=0) < 0:
        # a change-driven quality column leaves unchanged rows empty, the last word holds
        codes = codes[np.maximum.accumulate(np.where(codes >= 0, np.arange(len(codes)), 0))]
    return np.append(np.array(good, bool), only_faults)[codes], notes


def _good_numbers(values: FloatArray, further: tuple[str, ...], name: str, notes: list[Note], seen: dict[str, float]
                  ) -> NDArray[np.bool_]:
    wanted = [float(word) for word in further if re.fullmatch(r"\d+(?:\.\d+)?", word)]
    if wanted:
        return np.isin(values, wanted)
    known = values[np.isfinite(values)]
    if not len(known):
        return np.ones(len(values), bool)
    low = seen["low"] = min(seen.get("low", np.inf), float(known.min()))
    high = seen["high"] = max(seen.get("high", -np.inf), float(known.max()))
    usual = seen.setdefault("usual", float(np.median(known)))
    if high >= 1 << 30:  # OPC UA status codes: the two highest bits are the severity
        return np.isfinite(values) & (values < 1 << 30)
    if high >= 192:
        return np.isfinite(values) & (values >= 192) & (values < 256)
    if high == 100:
        return values == 100
    if _ONE_IS_GOOD.search(name) and low >= 0.0 and high <= 1.0:
        return values == 1.0
    if low == high and usual not in (0.0, 1.0):
        return np.zeros(len(values), bool)
    if low != high:
        notes.append(Note("quality_code", f"quality numbers are not OPC codes; {usual:g}, the most frequent, is taken "
                          "as good (--good-quality names others)"))
    return values == usual


def automatic(cells: Cells, further: tuple[str, ...]) -> tuple[FloatArray, list[Note]]:
    """Return (rows,) 1 where the controller was in automatic (or cascade), 0 where not, nan where not recorded.

    Numbers: 0 manual and 1, 2, 3 automatic or cascade; powers of two from 16 on as in Foundation Fieldbus.
    """
    notes: list[Note] = []
    extra = {word.strip().lower() for word in further}
    if not cells.is_text:
        values = cells.values
        return _auto_numbers(values, extra, notes), notes
    codes, words = cells.texts()
    values, bad, _ = parse_words(words)
    if words and np.isfinite(values[~bad]).all() and not bad.all():
        return _auto_numbers(np.append(values, np.nan)[codes], extra, notes), notes
    states, unknown = [], []
    for text in map(str.strip, words):
        if not text:
            states.append(np.nan)
            continue
        states.append(float(text.lower() in extra or bool(_AUTO.match(text))))
        if not states[-1] and not _MANUAL.match(text):
            unknown.append(text)
    if unknown:
        notes.append(Note("mode_words", f"modes {_some(unknown)} are not known and count as not automatic "
                          "(auto_modes in loops.toml names further ones)"))
    return np.append(np.array(states, float), np.nan)[codes], notes


def _auto_numbers(values: FloatArray, extra: set[str], notes: list[Note]) -> FloatArray:
    known = values[np.isfinite(values)]
    out = np.full(len(values), np.nan)
    present = np.isfinite(values)
    if not len(known):
        return out
    distinct = np.unique(known)
    named = [float(w) for w in extra if re.fullmatch(r"-?\d+(?:\.\d+)?", w)]
    if named:
        auto = np.isin(values, named)
    elif set(distinct) <= {0.0, 1.0, 2.0, 3.0}:
        auto = values >= 1
    elif all(v > 0 and v == int(v) and int(v) & (int(v) - 1) == 0 and v <= 128 for v in distinct):
        auto = np.isin(values, (16.0, 32.0, 64.0))
        notes.append(Note("mode_numbers", "modes are read as fieldbus numbers: 16, 32 and 64 are automatic"))
    else:
        auto = values == 1
        shown = ", ".join(f"{v:g}" for v in distinct[:5])
        notes.append(Note("mode_numbers", f"modes {shown} are not all known; only 1 counts as automatic (auto_modes in "
                          "loops.toml names others)"))
    out[present] = auto[present]
    return out


def _some(words: list[str]) -> str:
    shown = ", ".join(w.strip()[:20] or "(blank)" for w in words[:4])
    return shown + (", ..." if len(words) > 4 else "")
