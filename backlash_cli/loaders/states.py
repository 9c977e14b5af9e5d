"""Which samples count: qualities, modes; frozen, saturated, implausible, missing and filled samples."""

import re
from collections import Counter

import numpy as np
from numpy.typing import NDArray

from ..errors import some
from ..record import FloatArray, IntArray, Note, SampleState
from .cells import Cells
from .names import WORDS, noted

BEYOND = 0.5  # spans outside the range at which a measurement is no longer believed
AT_LIMIT = 1e-3  # of the output span: this close to 0 or 100 % is at the limit
LIMIT_RUN = 3  # samples at the limit that make saturation
FROZEN_RUN = 10  # equal samples below which nothing is called frozen
FROZEN_CHANCE = 1e-6  # chance that a noisy signal repeats itself this long anywhere in the record
LEAST_CHANGES = 50  # changes that any working measurement shows in a record, however slow and coarse
RESOLVED = 3.0  # recorder steps that a usual change of a noisy signal is large
OPPOSED = -0.2  # correlation of neighbouring changes below which there is noise
QUIET_SHARE = 0.25  # of the record: a signal without noise must stand still this long to be called frozen
LONE = FROZEN_RUN - 1  # samples in a row that may be lone zeros; more are frozen
FAR = 8.0  # usual moves from one sample to the next that a zero must lie outside of all others
_GOOD, _BAD, _DOUBT, _AUTO, _MANUAL = (re.compile("|".join(WORDS["words"][kind].split()), re.IGNORECASE)
                                       for kind in ("good", "bad", "doubt", "automatic", "manual"))
_ONE_IS_BAD = re.compile(r"inv|bad|question|fault", re.IGNORECASE)
_ONE_IS_GOOD = re.compile(r"^(?!.*(?:inv|bad|not|un)).*(?:valid|good|gültig|gueltig)", re.IGNORECASE)


def quality_words(words: list[str]) -> bool:
    """Say whether texts are qualities, and no modes or states."""
    plain = [word.strip() for word in words if len(word.strip()) > 1]
    return bool(plain) and all(_GOOD.fullmatch(word) or _BAD.fullmatch(word) for word in plain) and any(
        re.match(r"good|bad|gut|uncertain|0xc0", word, re.IGNORECASE) for word in plain)


def _numbers_or_words(cells: Cells, *, all_texts: bool) -> tuple[FloatArray | None, IntArray, list[str]]:
    """(numbers, codes, words) of cells: numbers are None where texts, all or some of them, are something else."""
    numbers, bad = cells.numbers()
    if not cells.is_text or (np.isfinite(numbers).any() and not (all_texts and bad.any())):
        return numbers, np.zeros(0, np.int64), []
    return None, *cells.texts()


def _named(further: tuple[str, ...]) -> tuple[set[str], list[float]]:
    """Further words that the user names, and the numbers among them."""
    extra = {word.strip().lower() for word in further}
    return extra, [float(word) for word in extra if re.fullmatch(r"-?\d+(?:\.\d+)?", word)]


def good_samples(cells: Cells, further: tuple[str, ...], name: str = "", known: dict[str, float] | None = None
                 ) -> tuple[NDArray[np.bool_], list[Note]]:
    """Return (rows,) True where the quality says good. Numbers are codes of OPC or PROFIBUS (128 and more), percents or
    0/1. further: words or numbers that mean good. name: Validity is 1 where good. known: by earlier chunks."""
    numbers, codes, words = _numbers_or_words(cells, all_texts=True)
    extra, wanted = _named(further)
    if words and not extra and all(re.fullmatch(r"\s*0[xX][0-9a-fA-F]{1,8}\s*", word) for word in words):
        numbers = np.append([float(int(word, 16)) for word in words], np.nan)[codes]
    if numbers is not None:
        if wanted or not np.isfinite(numbers).any():
            return np.isin(numbers, wanted) if wanted else np.ones(len(numbers), bool), []
        return _good_numbers(numbers, name, {} if known is None else known)
    if _ONE_IS_BAD.search(name) and all(re.fullmatch(r"\s*(?:true|false)\s*", word, re.IGNORECASE) for word in words):
        return np.append([word.strip().lower() == "false" for word in words], True)[codes], []
    good = [word.strip().lower() in extra or (
        bool(_GOOD.fullmatch(word.strip())) and not _DOUBT.fullmatch(word)) for word in words]
    if not any(good):  # only faults are marked: an empty cell is good
        return np.append(np.array(good, bool), True)[codes], [noted("quality_words", words=some(words, 4))]
    # a change-driven quality column leaves unchanged rows empty, the last word holds
    codes = codes[np.maximum.accumulate(np.where(codes >= 0, np.arange(len(codes)), 0))]
    return np.append(np.array(good, bool), False)[codes], []


def _good_numbers(values: FloatArray, name: str, seen: dict[str, float]) -> tuple[NDArray[np.bool_], list[Note]]:
    known = values[np.isfinite(values)]
    low = seen["low"] = min(seen.get("low", np.inf), float(known.min()))
    high = seen["high"] = max(seen.get("high", -np.inf), float(known.max()))
    usual = seen.setdefault("usual", float(np.median(known)))
    if high >= 1 << 30:  # OPC UA status codes: the two highest bits are the severity
        return values < 1 << 30, []
    if high >= 128:
        low_bits = values % (1 << 16)  # those above are of OPC HDA
        return (low_bits >= 128) & (low_bits < 256), []
    if high == 100 or (_ONE_IS_GOOD.search(name) and low >= 0.0 and high <= 1.0):
        return values == (100.0 if high == 100 else 1.0), []
    if low == high:
        return np.full(len(values), usual in (0.0, 1.0)) & (values == usual), []
    return values == usual, [noted("quality_code", usual=usual)]


def automatic(cells: Cells, further: tuple[str, ...]) -> tuple[FloatArray, list[Note]]:
    """Return (rows,) 1 where the controller was in automatic or cascade, 0 where not, nan where not recorded. Numbers:
    0 is manual, 1 to 3 are not; powers of two from 16 on as in Foundation Fieldbus."""
    numbers, codes, words = _numbers_or_words(cells, all_texts=False)
    extra, named = _named(further)
    if numbers is not None:
        return _auto_numbers(numbers, named)
    texts = [word.strip().lower() for word in words]
    auto = [text in extra or bool(_AUTO.fullmatch(text)) for text in texts]
    unknown = [word.strip() for word, text, yes in zip(words, texts, auto, strict=True)
               if text and not yes and not _MANUAL.fullmatch(text)]
    notes = [noted("mode_words", modes=some(unknown, 4))] if unknown else []
    states = [float(yes) if text else np.nan for text, yes in zip(texts, auto, strict=True)]
    return np.array([*states, np.nan])[codes], notes


def _auto_numbers(values: FloatArray, named: list[float]) -> tuple[FloatArray, list[Note]]:
    present = np.isfinite(values)
    distinct = np.unique(values[present])
    whole, notes = np.clip(distinct, 0, 256).astype(np.int64), []
    if named or np.isin(distinct, (0.0, 1.0, 2.0, 3.0)).all():
        auto = np.isin(values, named or (1.0, 2.0, 3.0))
    elif np.all((distinct == whole) & (whole > 0) & (whole <= 128) & (whole & (whole - 1) == 0)):
        auto = np.isin(values, (16.0, 32.0, 64.0))
        notes = [noted("mode_numbers:fieldbus")]
    else:
        auto, notes = values == 1, [noted("mode_numbers", modes=some([f"{v:g}" for v in distinct], 5))]
    return np.where(present, auto, np.nan), notes


def runs(flags: NDArray[np.bool_]) -> tuple[IntArray, IntArray]:
    """Return (starts, ends) of the stretches where `flags` is True; end is one past the last."""
    edges = np.flatnonzero(np.diff(flags, prepend=False, append=False))
    return edges[0::2], edges[1::2]


def short_holes(values: FloatArray, index: IntArray, longest: int) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Return (values, filled): holes (nan) of at most `longest` samples on a line, but not beside a jump of `index`."""
    starts, ends = runs(~np.isfinite(values))
    inner = (starts > 0) & (ends < len(values)) & (ends - starts <= longest)
    starts, ends = starts[inner], ends[inner]
    unbroken = index[ends] - index[starts - 1] == ends - starts + 1
    filled = inside(starts[unbroken], ends[unbroken], len(values))
    if not filled.any():
        return values, filled
    out, known = values.copy(), np.flatnonzero(np.isfinite(values))
    out[filled] = np.interp(np.flatnonzero(filled), known, values[known])
    return out, filled


def saturated(output: FloatArray) -> NDArray[np.bool_]:
    """(samples,) True where a normalised output stays at 0 or 1 for several samples."""
    starts, ends = runs((output <= AT_LIMIT) | (output >= 1.0 - AT_LIMIT))
    long = ends - starts >= LIMIT_RUN
    return inside(starts[long], ends[long], len(output))


def inside(starts: IntArray, ends: IntArray, samples: int) -> NDArray[np.bool_]:
    """(samples,) True in stretches that do not overlap; ends: one past the last."""
    found = np.zeros(samples, bool)
    for start, end in zip(starts.tolist(), ends.tolist(), strict=True):
        found[start:end] = True
    return found


def frozen(values: FloatArray) -> NDArray[np.bool_]:
    """(samples,) True where a measurement repeats one number for longer than its own noise allows.
    A signal with noise repeats a number with some chance p, so a run of L repeats somewhere among n samples has
    chance about n p^L; runs with less than FROZEN_CHANCE are frozen. A signal without noise may stand still, as a
    valve does in its dead band: it must do so for QUIET_SHARE of the record."""
    starts, ends = runs(values[1:] == values[:-1]) if len(values) >= 2 * LEAST_CHANGES else (np.zeros(0, int),) * 2
    lengths = ends - starts
    if lengths.max(initial=0) < FROZEN_RUN - 1:
        return np.zeros(len(values), bool)
    # of all new values, how many are repeated at once: a long run counts once, so it does not hide itself
    samples, p = len(values), (len(lengths) + 1.0) / (len(values) - int(lengths.sum()) + 2.0)
    p = min(max(p, 1e-4), 1.0 - LEAST_CHANGES / (samples - 1))
    limit = max(float(FROZEN_RUN - 1), float(np.log(FROZEN_CHANCE / samples) / np.log(p)))
    kept = lengths < limit
    if not kept.all() and not _noisy(values, starts[~kept], ends[~kept]):
        kept = lengths < max(limit, QUIET_SHARE * samples)
    return inside(starts[~kept], ends[~kept] + 1, samples)


def _noisy(values: FloatArray, starts: IntArray, ends: IntArray) -> bool:
    """Is the noise resolved: larger than the recorder's step, neighbouring changes opposed (correlated by -1/2)?"""
    changes = np.diff(values)
    # the steps into and out of a run are none of the noise
    keep = np.isfinite(changes) & ~inside(np.maximum(starts - 1, 0), ends + 1, len(changes))
    both = keep[1:] & keep[:-1]
    a, b = changes[:-1][both], changes[1:][both]
    power = float(a @ a + b @ b) / 2.0
    if len(a) < FROZEN_RUN or not power > 0 or float(a @ b) / power >= OPPOSED:
        return False
    sizes = np.abs(a[a != 0])
    return float(np.median(sizes)) >= RESOLVED * float(np.quantile(sizes, 0.01))


def lone_zeros(values: FloatArray) -> NDArray[np.bool_] | None:
    """(rows,) True where up to LONE samples are exactly 0 and lie far outside all others: FAR usual moves (99.9 %) and
    a fifth of the distance that all others span; None where there are none."""
    zero = values == 0.0
    if not zero.any() or zero.all():
        return None
    rest = values[~zero & np.isfinite(values)]
    if len(rest) < 20:
        return None
    low, high = float(rest.min()), float(rest.max())
    nearest = low if low > 0.0 else -high if high < 0.0 else 0.0
    if nearest <= max(FAR * float(np.quantile(np.abs(np.diff(rest)), 0.999)), 0.2 * (high - low)):
        return None
    starts, ends = runs(zero)
    few = (ends - starts <= LONE) & (starts > 0) & (ends < len(values))
    return inside(starts[few], ends[few], len(values)) if few.any() else None


_KINDS = {kind: (SampleState[state] if state else None, code) for kind, (state, code) in WORDS["samples"].items()}


def state_notes(counts: Counter[str], *kinds: str) -> list[Note]:
    """Say how many of all "samples" are of these kinds, in order."""
    found, samples = [], counts["samples"]
    for kind in filter(counts.get, kinds):
        if kind == "wild" and counts[kind] > 0.5 * samples:
            found.append(noted("outside_range", percent=100 * counts[kind] / samples))
        else:
            found.append(noted(_KINDS[kind][1], {"samples": float(counts[kind])}, of=samples))
    return found


def judged(index: IntArray, sp: FloatArray | None, pv: FloatArray, op: FloatArray | None,
           interpolated: NDArray[np.bool_] | None, manual: NDArray[np.bool_] | None, bridge: int
           ) -> tuple[FloatArray, NDArray[np.uint8], dict[str, NDArray[np.bool_]]]:
    """Return (measurement, state, marks): PV with holes of at most `bridge` samples filled, the SampleState of each
    sample, and where they are of the kinds of `state_notes`. All are (samples,). index: grid numbers. sp, pv, op:
    normalised, None where not recorded. interpolated: where PV was not recorded. manual: where not in automatic."""
    wild = (pv < -BEYOND) | (pv > 1.0 + BEYOND)
    y, filled = short_holes(np.where(wild, np.nan, pv) if wild.any() else pv, index, bridge)
    missing = ~np.isfinite(y)
    marks = {"wild": wild, "filled": filled, "frozen": frozen(y), "lost": missing & wild, "missing": missing & ~wild,
             "interpolated": interpolated, "saturated": None if op is None else saturated(op),
             "setpoint": None if sp is None else ~np.isfinite(sp), "output": None if op is None else ~np.isfinite(op)}
    state = np.zeros(len(index), np.uint8)
    for name, (value, _) in _KINDS.items():
        if name == "manual" and manual is not None:
            marks[name] = manual & (state != SampleState.MISSING) & (state != SampleState.IMPLAUSIBLE)
        if value is not None and (where := marks.get(name)) is not None:
            state[where] = value
    return y, state, {name: where for name, where in marks.items() if where is not None}
