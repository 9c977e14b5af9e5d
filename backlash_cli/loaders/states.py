"""What columns of qualities and of controller modes say of samples."""

import re
from collections.abc import Iterable
from statistics import median_low
from typing import Any

import numpy as np

from ..errors import some
from ..record import BoolArray, FloatArray, IntArray, Note
from .cells import Cells
from .names import FORM, is_column, noted, split_tag


def quality_words(words: list[str], named: str = "") -> bool:
    """Say whether texts are qualities, and no modes or states. named: the column is called so."""
    plain = [word.strip() for word in words if len(word.strip()) > 1]
    return bool(plain) and all(FORM.good.fullmatch(word) or FORM.bad.fullmatch(word) for word in plain) and any(
        named or re.match(r"good|bad|gut|uncertain|0xc0|i/?o.timeout|comm.fail", word, re.IGNORECASE) for word in plain)


def mode_words(words: list[str]) -> bool:
    """Say whether texts are modes of a controller."""
    return all(FORM.automatic.fullmatch(word.strip()) or FORM.manual.fullmatch(word.strip()) for word in words) and any(
        re.match("aut|man|cas|hand|[自手][动動]|[자수]동|авт|руч", word.strip(), re.IGNORECASE) for word in words)


def yes_or_no(words: list[str]) -> bool:
    """Say whether texts are but yes and no, or true and false, in some language."""
    return all(FORM.yes.fullmatch(word.strip()) or FORM.no.fullmatch(word.strip()) for word in words)


def _numbers_or_words(cells: Cells, further: tuple[str, ...], told: Iterable[str], *, all_texts: bool
                      ) -> tuple[FloatArray | None, IntArray, list[str], set[str], list[float]]:
    """(numbers, codes, words) of cells: numbers are None where texts, all or some of them, are something else; further
    words that the user names; the numbers among them, and those that a header tells."""
    (numbers, bad), extra = cells.numbers(), {word.strip().lower() for word in further}
    wanted = [float(word) for word in (*extra, *told) if re.fullmatch(r"-?\d+(?:\.\d+)?", word)]
    if not cells.is_text or (np.isfinite(numbers).any() and bad.sum() <= np.isfinite(numbers).sum() * (not all_texts)):
        return numbers, np.zeros(0, np.int64), [], extra, wanted
    return None, *cells.texts(), extra, wanted


def good_samples(cells: Cells, further: tuple[str, ...], name: str = "", known: dict[str, Any] | None = None
                 ) -> tuple[BoolArray, list[Note]]:
    """Return (rows,) True where the quality says good. Numbers are codes of OPC or PROFIBUS (128 and more), percents or
    0/1. further: words or numbers that mean good. name: Validity is 1 where good. known: by earlier chunks."""
    known = {} if known is None else known
    if is_column(name, "measure"):  # what stands in another one than the first is as good as none of this signal
        codes, words = cells.texts()
        first = known.setdefault("unit", words[codes[codes >= 0][0]] if words else "")
        return np.append(np.array([word == first for word in words], bool), True)[codes], [
            noted("other_unit", column=name, first=first, words=some(words))] * (words not in ([], [first]))
    meant = (number for number, word in FORM.legend.findall(name) if FORM.good.fullmatch(word))
    numbers, codes, words, extra, wanted = _numbers_or_words(cells, further, meant, all_texts=True)
    hexes = [re.fullmatch(r"\s*(0[xX][0-9a-fA-F]{1,8})\s*(?:\(.*\)\s*)?", word) for word in words]  # 0x00C0 (Good)
    if words and not extra and all(hexes):
        numbers = np.append([float(int(found[1], 16)) for found in hexes if found], np.nan)[codes]
    if numbers is not None:
        if wanted or not np.isfinite(numbers).any():
            return np.isin(numbers, wanted) if wanted else np.ones(len(numbers), bool), []
        return _good_numbers(numbers, name, known)
    if FORM.one_is_bad.search(name) and yes_or_no(words):
        return np.append([bool(FORM.no.fullmatch(word.strip())) for word in words], True)[codes], []
    good = [word.strip().lower() in extra or (
        bool(FORM.good.fullmatch(word.strip())) and not FORM.doubt.fullmatch(word)) for word in words]
    told = any(good) or extra or len(words) > 1 or len(cells.lexicon.words) > 1 or codes.min() < 0
    if not told and not FORM.bad.fullmatch(words[0].strip()) and not FORM.doubt.fullmatch(words[0]):  # one word
        return np.ones(len(codes), bool), [noted("quality_words:one", word=words[0].strip()[:40])]
    if not any(good):  # only faults are marked: an empty cell is good
        return np.append(np.array(good, bool), True)[codes], [noted("quality_words", words=some(words, 4))]
    codes = codes[np.maximum.accumulate(np.where(codes >= 0, np.arange(len(codes)), 0))]  # unchanged rows are empty
    return np.append(np.array(good, bool), False)[codes], []


def _good_numbers(values: FloatArray, name: str, seen: dict[str, Any]) -> tuple[BoolArray, list[Note]]:
    known = values[np.isfinite(values)]
    low = seen["low"] = min(seen.get("low", np.inf), float(known.min()))
    high = seen["high"] = max(seen.get("high", -np.inf), float(known.max()))
    seen["usual"] = [*seen.get("usual", ()), float(np.median(known))]
    usual = median_low(seen["usual"])
    if FORM.one_is_bad.search(name) and low >= 0.0 and (high <= 1.0 or usual == 0.0):  # or numbers of faults
        return values == 0.0, []
    if high >= 1 << 30:  # OPC UA status codes: the two highest bits are the severity
        return values < 1 << 30, []
    if high >= 128:  # 128 to 255, below the bits of OPC HDA
        return values % (1 << 16) // 128 == 1.0, []
    if high == 100 or (FORM.one_is_good.search(name) and low >= 0.0 and high <= 1.0):
        return values == (100.0 if high == 100 else 1.0), []
    if low == high:  # multiples of 4 are codes of OPC for what is bad
        good = usual == 0.0 or usual % 4.0 > 0.0
        return (values == usual) & good, [noted("quality_one", usual=usual)] * (good and usual != 1.0)
    return values == usual, [noted("quality_code", usual=usual)]


def automatic(cells: Cells, further: tuple[str, ...], name: str = "") -> tuple[FloatArray, list[Note]]:
    """Return (rows,) 1 where the controller was in automatic or cascade, 0 where not, nan where not recorded. Numbers:
    as `name` says (0=Auto); 1 is manual of MAN; else 0 is, and 1 to 3 are not; or as in DeltaV, where 8 is manual."""
    if FORM.one_is_manual.fullmatch(split_tag(name).signal) and not mode_words(texts := cells.texts()[1]):
        # MAN may also be what the output is in manual
        return 1.0 - automatic(cells, further)[0] if yes_or_no(texts) else np.full(len(cells.values), np.nan), []
    meant = (n for n, word in FORM.legend.findall(FORM.compact.sub("3=Auto", name)) if FORM.automatic.fullmatch(word))
    numbers, codes, words, extra, named = _numbers_or_words(cells, further, meant, all_texts=False)
    if numbers is not None:
        return _auto_numbers(numbers, named)
    texts = [word.strip() for word in words]
    on, off = (FORM.yes, FORM.no) if yes_or_no(texts) else (FORM.automatic, FORM.manual)
    auto = [text.lower() in extra or bool(on.fullmatch(text)) for text in texts]
    unknown = [text for text, yes in zip(texts, auto, strict=True) if text and not yes and not off.fullmatch(text)]
    states = [float(yes) if text else np.nan for text, yes in zip(texts, auto, strict=True)]
    return np.array([*states, np.nan])[codes], [noted("mode_words", modes=some(unknown, 4))] * bool(unknown)


def _auto_numbers(values: FloatArray, named: list[float]) -> tuple[FloatArray, list[Note]]:
    present = np.isfinite(values)
    distinct = np.unique(values[present])
    whole = np.clip(distinct, 0, 256).astype(np.int64)
    if named or np.isin(distinct, (0.0, 1.0, 2.0, 3.0)).all():
        auto = np.isin(values, named or (1.0, 2.0, 3.0))
        notes = [noted("mode_numbers:usual")] if len(distinct) > 1 and not named else []
    elif np.all((distinct == whole) & (whole > 0) & (whole <= 128) & (whole & (whole - 1) == 0)):
        auto, notes = np.isin(values, (16.0, 32.0, 64.0)), [noted("mode_numbers:deltav")]
    else:
        auto, notes = values == 1, [noted("mode_numbers", modes=some([f"{v:g}" for v in distinct], 5))]
    return np.where(present, auto, np.nan), notes
