"""PV one block ahead: what its own past, the past of OP and their curvature tell of the next block mean of PV.

    predictor(recordings, size, scale) -> Predictor | None

The common ground of every question asked of a loop. No structure is assumed of process, load or controller: past PV
and past OP, fine and then in means over doubling spans, stand for any linear process with any dead time, for any load
that drifts or swings, and for the controller; squares and products for a curved valve characteristic or a gain that
moves with the operating point. Two things make it hold on loads that do not look like noise:

    surprises   what the linear prediction missed by far, kept as columns of their own. After a step of the load the
                best prediction believes a large surprise and mistrusts a small one; a linear one cannot do both, and a
                dead band, which passes large moves and swallows small ones, would be found in every such loop.
    weights     errors count as Student's t with 4 degrees of freedom, so that single shocks do not rule.

Blocks are regressed on what lies before them only: under feedback OP answers PV, never the other way within a block.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..record import FloatArray, IntArray

LEAST_ROWS, FEWEST_ROWS = 25, 60  # rows beyond the number of columns, and at least
COMPLETE = 0.6  # share of a block's samples that must be usable
SURPRISE = 2.0  # robust standard deviations of the prediction error beyond which it is a surprise
SURPRISE_LAGS, SURPRISE_SPAN = 6, 8  # blocks: single ones, and the mean over those before
FREEDOM = 4.0  # of Student's t
ROUNDS = 4  # of the weights
RIDGE = 1e-8  # of the diagonal: columns that repeat each other do no harm
MODEL_ERROR = 0.002  # of the deviation of PV: no model of a process is better than that, however little noise there is


@dataclass(frozen=True)
class Recording:
    """Samples without a gap in time: output, measurement (samples,) of any units, and which of them may be used.

    begin: number of the first sample on the grid of the whole record.
    """

    output: FloatArray
    measurement: FloatArray
    usable: NDArray[np.bool_]
    begin: int = 0


def recording_of(index: IntArray, output: FloatArray, measurement: FloatArray, usable: NDArray[np.bool_],
                 scale: float = 1.0) -> Recording:
    """Samples (samples,) put on the grid from the first to the last of them: OP held, NaN where not known, PV straight
    between the usable ones, both times `scale`. index: strictly increasing places on the grid."""
    at = index - index[0]
    grid = np.arange(at[-1] + 1)
    held, good = np.full(len(grid), np.nan), np.zeros(len(grid), dtype=bool)
    held[at], good[at] = scale * output, usable
    known = np.isfinite(held)
    last = np.where(known, grid, np.argmax(known))
    held = held[np.maximum.accumulate(last, out=last)]
    del last  # a long record's arrays are as large as what is made of them
    return Recording(held, np.interp(grid, at[usable], scale * measurement[usable]), good, int(index[0]))


@dataclass(frozen=True)
class Lags:
    """How far back a prediction looks: `fine` single blocks, then `far` means over 2, 4, 8 .. blocks, and how many
    lags of OP squared and of the products with PV."""

    fine: int
    far: int
    squares: int
    products: int

    @property
    def count(self) -> int:
        return self.fine + self.far

    @property
    def reach(self) -> int:
        return self.fine + 2 * (2**self.far - 1) + 1

    def spread(self, coefficients: FloatArray) -> FloatArray:
        """Coefficients (count,) as those of single blocks (reach - 1,)."""
        far = [np.full(2 * 2**i, coefficients[self.fine + i] / (2 * 2**i)) for i in range(self.far)]
        return np.concatenate([coefficients[: self.fine], *far])


def lags_for(blocks: int) -> Lags:
    """Fewer lags for short records: each costs evidence that a short record does not have."""
    return Lags(6, 3, 3, 2) if blocks > 600 else Lags(4, 3, 1, 1) if blocks > 250 else Lags(3, 2, 1, 0)


@dataclass(frozen=True)
class Predictor:
    """A fitted prediction and all that is needed to ask whether something more explains PV.

    columns: (columns, rows): ones, past PV, past OP, the rest. target, weights, error: (rows,). inverse: of the
    weighted Gram matrix. past_measurement, past_output: where their lags stand among the columns. loss: weighted sum
    of squared errors, that of an imperfect model included. coefficients: (columns,).
    """

    size: int
    lags: Lags
    columns: FloatArray
    target: FloatArray
    weights: FloatArray
    error: FloatArray
    coefficients: FloatArray
    gram: FloatArray
    inverse: FloatArray
    loss: float
    past_measurement: slice
    past_output: slice
    every: int
    _recordings: tuple[Recording, ...]
    _rows: tuple[NDArray[np.int64], ...]

    @property
    def rows(self) -> int:
        return len(self.target)

    def lagged(self, means: Callable[[FloatArray, int, int], FloatArray], count: int = 0) -> FloatArray:
        """Lags of further signals, (signals, lags, rows), the first `count` of them or all. means(output, size, blocks)
        gives them as (signals, blocks) of one recording's output."""
        parts = []
        for recording, rows in zip(self._recordings, self._rows, strict=True):
            signals = means(recording.output, self.size, len(recording.output) // self.size)
            parts.append(_level(_lags_of(signals, self.lags, rows, count), len(self._rows) > 1))
        return np.concatenate(parts, axis=2) if len(parts) > 1 else parts[0]


def predictor(recordings: Sequence[Recording], size: int, span: float, most: int) -> Predictor | None:
    """Fit the prediction of block means of `size` samples; None where too few blocks can be used.

    span: of OP, in its units. most: rows; of more, every second, third .. is taken, each with all that lies before it.
    Several recordings of one loop share one prediction, each with a level of its own.
    """
    blocks = sum(len(r.output) // size for r in recordings)
    lags = lags_for(blocks)
    deviation = float(np.sqrt(np.mean(np.concatenate([r.measurement - r.measurement.mean() for r in recordings]) ** 2)))
    used, rows, columns, target, at = [], [], [], [], []
    for r in recordings:
        where = _usable_rows(r, size, lags)
        if len(where) > (LEAST_ROWS if len(recordings) > 1 else 0):
            used.append(r)
            rows.append(where)
    if not used or sum(map(len, rows)) < lags.count * 3 + LEAST_ROWS or deviation == 0.0:
        return None
    for r, where in zip(used, rows, strict=True):
        y, H = _columns(r, size, lags, where, span, deviation)
        target.append(_level(y, len(used) > 1))
        columns.append(_level(H, len(used) > 1))
        at.append(where)
    y, H = np.concatenate(target), np.concatenate(columns, axis=1)
    every = -(-len(y) // most)
    n = len(y[::every])
    first, _, _ = _fitted(H[:, ::every], y[::every])
    H = np.vstack([H, _surprises(y - first @ H, at)])
    H = H[np.any(H != 0.0, axis=1), ::every] if every > 1 else H[np.any(H != 0.0, axis=1)]
    y = y[::every]
    if n < max(len(H) + LEAST_ROWS, FEWEST_ROWS):
        return None
    b, w, gram = _fitted(H, y)
    error = y - b @ H
    floor = float(np.sum(w)) * (MODEL_ERROR * deviation) ** 2
    base = 0 if len(used) > 1 else 1
    raw = len(_last(size))
    counts = np.cumsum([0, *map(len, rows)])
    taken = np.arange(0, counts[-1], every)
    kept = tuple(where[taken[(taken >= i) & (taken < k)] - i]
                 for where, i, k in zip(rows, counts, counts[1:], strict=False))
    inverse = np.asarray(np.linalg.inv(gram), dtype=np.float64)
    return Predictor(size, lags, H, y, w, error, b, gram, inverse, float(w @ error**2) + floor,
                     slice(base, base + lags.count), slice(base + lags.count + raw, base + 2 * lags.count + raw),
                     every, tuple(used), kept)


def block_means(values: FloatArray, size: int) -> FloatArray:
    """Means (blocks,) over whole blocks of `size` samples."""
    count = len(values) // size
    means: FloatArray = values[: count * size].reshape(count, size).mean(1)
    return means


def _usable_rows(r: Recording, size: int, lags: Lags) -> NDArray[np.int64]:
    """Numbers of the blocks that are complete, as are all that their prediction looks back on."""
    bad = np.cumsum(np.append(0, block_means(r.usable.astype(float), size) < COMPLETE))
    count = len(bad) - 1
    if count <= lags.reach:
        return np.empty(0, dtype=np.int64)
    return np.flatnonzero(bad[lags.reach + 1 :] == bad[: count - lags.reach]) + lags.reach


def _columns(r: Recording, size: int, lags: Lags, rows: NDArray[np.int64], span: float,
             deviation: float) -> tuple[FloatArray, FloatArray]:
    u, y = r.output, r.measurement
    parts = []
    for values in (y, u):
        parts += [_lags_of(block_means(values, size)[None], lags, rows)[0], _last_means(values, size, rows)]
    products = ((u * u / span, lags.squares), (u * y / span, lags.products), (y * y / deviation, lags.products))
    for values, count in products:
        means = block_means(values, size)
        parts += [means[rows - i][None] for i in range(1, count + 1)]
    return block_means(y, size)[rows], np.vstack([np.ones((1, len(rows))), *parts])


def _lags_of(signals: FloatArray, lags: Lags, rows: NDArray[np.int64], count: int = 0) -> FloatArray:
    """The first `count` lags, or all, of block means (signals, blocks) before the rows, (signals, lags, rows)."""
    first, last, every = int(rows[0]), int(rows[-1]), int(rows[1] - rows[0]) if len(rows) > 1 else 1
    even = len(rows) == (last - first) // every + 1 and bool(np.all(np.diff(rows) == every))

    def before(values: FloatArray, back: int) -> FloatArray:
        return values[first - back : last - back + 1 : every] if even else values[rows - back]

    found = np.empty((len(signals), count or lags.count, len(rows)))
    for means, into in zip(signals, found, strict=True):  # one by one: a long record's sums are as large as itself
        for i in range(min(lags.fine, len(into))):
            into[i] = before(means, 1 + i)
        if len(into) > lags.fine:
            total, back, width = np.cumsum(means), lags.fine + 1, 2  # rows begin at lags.reach: no sum reaches below 0
            for i in range(lags.fine, len(into)):
                into[i] = (before(total, back) - before(total, back + width)) / width
                back, width = back + width, 2 * width
    return found


def _last(size: int) -> list[int]:
    return sorted({1, 2, max(1, size // 4), max(1, size // 2)} - {size}) if size > 1 else []


def _last_means(values: FloatArray, size: int, rows: NDArray[np.int64]) -> FloatArray:
    """Means of the last 1, 2, size/4 and size/2 samples before each block: what has just happened."""
    total = np.append(0.0, np.cumsum(values))
    return np.array([(total[rows * size] - total[rows * size - n]) / n for n in _last(size)]).reshape(-1, len(rows))


def _surprises(error: FloatArray, at: Sequence[NDArray[np.int64]]) -> FloatArray:
    """Lags of what lies outside SURPRISE deviations of the prediction error, (lags, rows)."""
    limit = SURPRISE * 1.4826 * float(np.median(np.abs(error)))
    beyond = error - np.clip(error, -limit, limit)
    parts, done = [], 0
    for rows in at:
        line = np.zeros(rows[-1] + 1)
        line[rows] = beyond[done : done + len(rows)]
        done += len(rows)
        total = np.append(0.0, np.cumsum(line))
        single = [line[np.maximum(rows - i, 0)] * (rows >= i) for i in range(1, SURPRISE_LAGS + 1)]
        end = np.maximum(rows - SURPRISE_LAGS, 0)
        parts.append(np.array([*single, (total[end] - total[np.maximum(end - SURPRISE_SPAN, 0)]) / SURPRISE_SPAN]))
    return np.concatenate(parts, axis=1)


def _level(values: FloatArray, several: bool) -> FloatArray:
    """Each recording less its own mean, where there are several of them."""
    return values - values.mean(axis=-1, keepdims=True) if several else values


def _fitted(H: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Coefficients (columns,), Student weights (rows,) and weighted Gram matrix of the regression of y on H."""
    w, weighted = np.ones(len(y)), np.empty_like(H)
    for again in range(ROUNDS + 1):
        np.multiply(H, w, out=weighted)
        gram = weighted @ H.T
        diagonal = np.einsum("ii->i", gram)  # a view
        diagonal *= 1.0 + RIDGE
        diagonal += 1e-12
        b: FloatArray = np.asarray(np.linalg.solve(gram, weighted @ y), dtype=np.float64)
        if again == ROUNDS:
            break
        error = y - b @ H
        variance = float(np.mean(w * error**2))
        if not again:
            variance = min(variance, (1.4 * float(np.median(np.abs(error)))) ** 2)
        w = (FREEDOM + 1.0) / (FREEDOM + error**2 / max(variance, 1e-300))
    return b, w, gram
