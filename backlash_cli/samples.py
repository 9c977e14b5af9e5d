"""Which samples of a loop count (none frozen, saturated, implausible, missing), and what holds between its records."""

from collections import Counter

import numpy as np
from numpy.typing import NDArray

from .record import AT_LIMIT, BoolArray, FloatArray, IntArray, Note, SampleState, quantile, runs
from .words import WORDS, noted

MAX_HOLE = 5  # absent samples that may be bridged
BEYOND, OP_BEYOND = 0.5, 0.1  # spans outside the range at which a measurement is no longer believed, an output doubted
APART, MOSTLY = 1.0 / 3.0, 0.95  # spans between SP and PV that are no control error in this share of a record
LIMIT_RUN = 3  # samples at the limit that make saturation
RESTS, LEAST_LEVELS, HALF_AS_FAR = 0.2, 20, 0.5  # so long an output of so many levels stands at no end
FROZEN_RUN = 10  # equal samples below which nothing is called frozen
FROZEN_CHANCE = 1e-6  # chance that a noisy signal repeats itself this long anywhere in the record
LEAST_CHANGES = 50  # changes that any working measurement shows in a record, however slow and coarse
RESOLVED = 3.0  # recorder steps that a usual change of a noisy signal is large
OPPOSED = -0.2  # correlation of neighbouring changes below which there is noise
QUIET_SHARE = 0.25  # of the record: a signal without noise must stand still this long to be called frozen
STANDINS = (-32768.0, 32767.0, 65535.0, *(sign * ten - sign for ten in (1e3, 1e4, 1e5, 1e6) for sign in (-1.0, 1.0)))
LARGEST = 1e29  # no plant measures more
CONVERTED = 2.5  # times larger or smaller (3.6: l/s and m3/h): another unit, no other state of the plant
LOOK, ALIKE = 256, 0.999  # samples at each place, and correlation, of an output that is PV in another unit
PASTED, REPEATED = 32, 0.2  # samples that no noise makes twice; share of a record from which on this is told
LONE = FROZEN_RUN - 1  # samples in a row that may be lone zeros; more are frozen
TORN = 2.0  # times as far from row to row as in the order of the file: that is no order of time
FAR = 8.0  # usual moves from one sample to the next that a stand-in must lie outside of all others


def inside(starts: IntArray, ends: IntArray, samples: int) -> BoolArray:
    """(samples,) True in stretches that do not overlap; ends: one past the last."""
    found = np.zeros(samples, bool)
    for start, end in zip(starts.tolist(), ends.tolist(), strict=True):
        found[start:end] = True
    return found


def short_holes(values: FloatArray, index: IntArray, longest: int) -> tuple[FloatArray, BoolArray]:
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


def torn(values: FloatArray, before: FloatArray) -> bool:
    """Whether values (rows,) jump much farther from row to row than in the order they had before."""
    with np.errstate(over="ignore", invalid="ignore"):
        now, then = (float(np.nansum(np.abs(np.diff(x)))) for x in (values, before))
    return now > TORN * then


def linear(times: IntArray, stamps: IntArray, values: FloatArray, limit: float, few: float) -> FloatArray:
    """(samples,) Values at `times` on lines between good records at most `limit` microseconds apart, `few` where a bad
    one (nan) lies between them; else nan."""
    good = np.isfinite(values)
    known, heights = stamps[good], values[good]
    if len(known) < 2:
        return np.full(len(times), np.nan)
    out = np.interp((times - known[0]).astype(float), (known - known[0]).astype(float), heights, np.nan, np.nan)
    after = np.searchsorted(known, times).clip(1, len(known) - 1)
    wide = np.diff(known) > np.where(np.diff(np.searchsorted(stamps[~good], known)) > 0, min(few, limit), limit)
    out[wide[after - 1] & (known[after] != times) & (known[after - 1] != times)] = np.nan
    return out


def held(times: IntArray, stamps: IntArray, values: FloatArray, limit: float, few: float) -> FloatArray:
    """(samples,) The last good record at or before each of `times`; nan before the first, after `limit` microseconds,
    and from a bad record (nan) on where two good ones around it lie more than `few` microseconds apart."""
    good = np.isfinite(values)
    if not good.any():
        return np.full(len(times), np.nan)
    known, heights = stamps[good], values[good]
    last = np.searchsorted(known, times, side="right") - 1
    before, after = known[last.clip(0)], np.append(known, 1 << 62)[last + 1]
    out = np.where((last >= 0) & (times - before <= limit), heights[last], np.nan)
    out[(stamps[np.searchsorted(stamps, times, side="right") - 1] > before) & (after - before > few)] = np.nan
    return out


def saturated(output: FloatArray, off: FloatArray | None = None) -> BoolArray:
    """(samples,) True where a normalised output stays for several samples at 0 or 1, or at the end of its own range: at
    RESTS of its samples, though PV is as far `off` SP as elsewhere, which moves any output with integral action."""
    at = (output <= AT_LIMIT) | (output >= 1.0 - AT_LIMIT)
    for end in () if off is None else (np.fmin.reduce(output, initial=np.inf), np.fmax.reduce(output, initial=-np.inf)):
        rests = output == end
        if np.count_nonzero(rests) > RESTS * len(output) and len(np.unique(output)) >= LEAST_LEVELS:
            far = np.nan_to_num(np.minimum(off, 1.0))  # type: ignore[arg-type]
            if np.mean(far[rests]) > HALF_AS_FAR * np.mean(far[~rests]):
                at |= rests
    starts, ends = runs(at)
    long = ends - starts >= LIMIT_RUN
    return inside(starts[long], ends[long], len(output))


def frozen(values: FloatArray) -> BoolArray:
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
    return quantile(sizes, 0.5) >= RESOLVED * quantile(sizes, 0.01)


def no_values(values: FloatArray) -> BoolArray | None:
    """(rows,) True where samples are exactly 0, up to LONE in a row, or one of STANDINS, and lie far outside all
    others: FAR usual moves (99.9 %) and a fifth of the distance that all others span; or beyond LARGEST; None: none."""
    outer = float(np.fmin.reduce(values, initial=np.inf)), float(np.fmax.reduce(values, initial=-np.inf))
    if max(-outer[0], outer[1]) > LARGEST:
        beyond = np.abs(values) > LARGEST
        return beyond if (further := no_values(np.where(beyond, np.nan, values))) is None else beyond | further
    found: BoolArray | None = None
    there = {0.0, *STANDINS} & {*outer}  # a zero lies outside all others where they all do, or a larger one is gone
    for number in sorted(there and {0.0, *there}, key=abs, reverse=True):
        same = values == number
        rest = values[~same & np.isfinite(values)] if same.any() else values[:0]
        if len(rest) < 20:
            continue
        low, high = float(rest.min()) - number, float(rest.max()) - number
        if (away := max(low, -high)) <= 0.2 * (high - low) or away <= FAR * quantile(np.abs(np.diff(rest)), 0.999):
            continue
        if not number:
            starts, ends = runs(same)
            few = (ends - starts <= LONE) & (starts > 0) & (ends < len(values))
            same = inside(starts[few], ends[few], len(values))
        values, found = np.where(same, np.nan, values), same if found is None else found | same
    return found if found is not None and found.any() else None


def changed_size(values: FloatArray) -> tuple[int, int]:
    """Return how many samples at the end are CONVERTED times as large or small as all before, with the same relative
    moves, at one stroke; and how many are small of a signal that jumps to its thousandfold and back time and again."""
    least, most = values.min(initial=np.inf), values.max(initial=-np.inf)
    if 0.0 < most / CONVERTED < least:
        return 0, 0
    sizes = values if least > 0.0 else values[values > 0.0]
    small = sizes / CONVERTED
    far = np.flatnonzero((small[1:] >= sizes[:-1]) | (small[:-1] >= sizes[1:]))
    if len(sizes) < 100 or not len(far):
        return 0, 0
    steps = np.abs(np.log(sizes[far + 1]) - np.log(sizes[far]))
    jumps = np.count_nonzero(np.abs(steps - np.log(1000.0)) < np.log(1.5))
    if jumps > max(0.01 * (len(sizes) - 1), 0.9 * len(far)):
        return 0, int(np.count_nonzero(sizes < sizes.max() / 1000.0**0.5))
    cut = 1 + int(far[np.argmax(steps)])
    below, above = sorted((sizes[:cut], sizes[cut:]), key=lambda part: float(part[0]))
    if min(len(below), len(above)) < 20 or above.min() / CONVERTED < below.max():
        return 0, 0
    moves, others = (quantile(np.abs(np.diff(np.log(part))), 0.5) for part in (below, above))
    return (len(values) - int(np.flatnonzero(values > 0.0)[cut])) * (0.6 * moves < others < 1.7 * moves), 0


def pasted(values: FloatArray) -> BoolArray | None:
    """(samples,) True where a measurement with noise is, number by number, what it was before, as in data pasted twice;
    None where a look at two places shows nothing of it."""
    n, lags = len(values), Counter[int]()
    for at in (n // 4, 3 * n // 4) if n > 4 * PASTED else ():
        look = values[at : at + PASTED]
        if np.count_nonzero(np.diff(np.sign(np.diff(look)))) < PASTED // 4 or len({*look.tolist()}) < PASTED // 2:
            continue  # without noise: a cycle may repeat itself
        top = int(look.argmax())  # the rarest sample: few others are alike
        same = np.flatnonzero(values[top : n - PASTED + 1 + top] == look[top])
        same = same[(values[same[:, None] + np.arange(PASTED)] == look).all(axis=1)]
        lags.update(np.abs(same[same != at] - at).tolist())
    lag = max(lags, key=lags.__getitem__, default=n)
    found = np.append(np.zeros(lag, bool), values[lag:] == values[: n - lag])
    return found if np.count_nonzero(found) > REPEATED * n else None


def is_copy(output: FloatArray, measurement: FloatArray) -> bool:
    """Say whether an output is the measurement in another unit: they lie on one line, and so do their changes, in a
    look at some places. A controller answers the changes of PV, and not its level, in such a way."""
    places = np.array([[0], [1], [3]]) * len(output) // 4 + np.arange(min(LOOK, len(output) // 4))
    x, y = output[places], measurement[places]
    x, y = (one[np.isfinite(x + y).all(axis=1)] for one in (x, y))
    centred = ([(one - one.mean()).ravel() for one in pair] for pair in ((np.diff(x), np.diff(y)), (x, y)))
    return x[:, 1:].size > 1 and all(a @ b > ALIKE * float((a @ a) * (b @ b)) ** 0.5 for a, b in centred)


STRANGE = ("apart", "copied", "mirrored")  # not the signals of one loop
_KINDS = {kind: (SampleState[state] if state else None, code) for kind, (state, code) in WORDS["samples"].items()}


def state_notes(counts: Counter[str], *kinds: str) -> list[Note]:
    """Say how many of all "samples" are of these kinds, in order."""
    found, samples = [], counts["samples"]
    for kind in filter(counts.get, kinds):
        if (kind in STRANGE and counts[kind] < MOSTLY * samples) or (kind == "beyond" and counts[kind] == samples):
            continue
        if kind == "wild" and counts[kind] > 0.5 * samples:
            found.append(noted("outside_range", percent=100 * counts[kind] / samples))
        else:
            effect = {"effect": "blocks"} if kind in STRANGE else {"effect": "limits"} if kind == "beyond" else {}
            code = "frozen:all" if kind == "frozen" and counts[kind] == samples else _KINDS[kind][1]
            found.append(noted(code, {"samples": float(counts[kind]), **effect}, of=samples))
    return found


def judged(index: IntArray, sp: FloatArray | None, pv: FloatArray, op: FloatArray | None,
           interpolated: BoolArray | None, manual: BoolArray | None, bridge: int,
           mirrored: BoolArray | None = None) -> tuple[FloatArray, NDArray[np.uint8], dict[str, BoolArray]]:
    """Return (measurement, state, marks): PV with holes of at most `bridge` samples filled, the SampleState of each
    sample, and where they are of the kinds of `state_notes`. All are (samples,). index: grid numbers. sp, pv, op:
    normalised, None: not recorded. interpolated: PV not recorded; manual: not in automatic; mirrored: OP is PV."""
    wild = (pv < -BEYOND) | (pv > 1.0 + BEYOND)
    y, filled = short_holes(np.where(wild, np.nan, pv) if wild.any() else pv, index, bridge)
    missing, off = ~np.isfinite(y), None if sp is None else np.abs(apart := sp - pv, out=apart)
    marks = {"apart": None if off is None else off > APART, "copied": None if off is None else off == 0.0,
             "mirrored": mirrored, "wild": wild, "filled": filled, "repeated": pasted(pv), "frozen": frozen(y),
             "lost": missing & wild, "missing": missing & ~wild, "interpolated": interpolated,
             "saturated": None if op is None else saturated(op, off),
             "beyond": None if op is None else np.abs(op - 0.5) > 0.5 + OP_BEYOND,
             "setpoint": None if sp is None else ~np.isfinite(sp), "output": None if op is None else ~np.isfinite(op)}
    state = np.zeros(len(index), np.uint8)
    for name, (value, _) in _KINDS.items():
        if name == "manual" and manual is not None:
            marks[name] = manual & (state != SampleState.MISSING) & (state != SampleState.IMPLAUSIBLE)
        if value is not None and (where := marks.get(name)) is not None and where.any():
            state[where] = value
    return y, state, {name: where for name, where in marks.items() if where is not None}
