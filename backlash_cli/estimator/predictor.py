"""PV one block ahead: what its own past, the past of OP and their curvature tell of the next block mean of PV.

    predictor(recordings in blocks, deviation of PV, rows) -> Predictor | None

The common ground of every question asked of a loop. No structure is assumed of process, load or controller: past PV
and past OP, fine and then in means over doubling spans, stand for any linear process with any dead time, for any load
that drifts or swings, and for the controller; squares and products for a curved valve characteristic or a gain that
moves with the operating point. Two things make it hold on loads that do not look like noise:

    surprises   what the linear prediction missed by far, kept as columns of their own. After a step of the load the
                best prediction believes a large surprise and mistrusts a small one; a linear one cannot do both, and a
                dead band, which passes large moves and swallows small ones, would be found in every such loop.
    weights     errors count as Student's t with 4 degrees of freedom, so that single shocks do not rule.

Blocks are regressed on what lies before them only: under feedback OP answers PV, never the other way within a block.
OP counts as known to RESOLUTION. What is finer the controller made of samples of PV that were not recorded: an OP to
its last digit tells of PV as a sensor does, and what PV answers to it cannot be seen beside that."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..record import BoolArray, FloatArray, Frozen, IntArray, hold

LEAST_ROWS, FEWEST_ROWS = 25, 60  # rows beyond the number of columns, and at least
COMPLETE = 0.6  # share of a block's samples that must be usable
SURPRISE = 2.0  # robust standard deviations of the prediction error beyond which it is a surprise
SURPRISE_LAGS, SURPRISE_SPAN = 6, 8  # blocks: single ones, and the mean over those before
FREEDOM = 4.0  # of Student's t
ROUNDS, STANDS = 4, 0.05  # of the weights, at most; change of the variance, as a share, from which they stand
RIDGE = 1e-8  # of the diagonal: columns that repeat each other do no harm
LEVELS = 50  # at most: of more recordings, neighbours share one
RESOLUTION = 0.007  # of the deviation of OP: no valve follows it closer than that
MODEL_ERROR = 0.002  # of the deviation of PV: no model of a process is better than that, however little noise there is


class Recording(Frozen):
    """Samples without a gap in time: output, measurement (samples,) of any units, and which of them may be used."""

    output: FloatArray
    measurement: FloatArray
    usable: BoolArray


def recording_of(index: IntArray, output: FloatArray, measurement: FloatArray, usable: BoolArray,
                 scale: float = 1.0) -> Recording:
    """Samples (samples,) put on the grid from the first to the last of them: OP held, NaN where not known, PV straight
    between the usable ones, both times `scale`. index: strictly increasing places on the grid."""
    at = index - index[0]
    grid = np.arange(at[-1] + 1)
    known, good = np.full(len(grid), np.nan), np.zeros(len(grid), dtype=bool)
    known[at], good[at] = scale * output, usable
    return Recording(hold(known), np.interp(grid, at[usable], scale * measurement[usable]), good)


class Lags(Frozen):
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
        """Coefficients (.., count), or of the first lags, as those of single blocks (.., reach - 1)."""
        lengths = np.append(np.ones(self.fine, dtype=int), 2 << np.arange(self.far))[: coefficients.shape[-1]]
        return np.repeat(coefficients / lengths, lengths, axis=-1)


def lags_for(blocks: int) -> Lags:
    """Fewer lags for short records: each costs evidence that a short record does not have."""
    return Lags(6, 3, 3, 2) if blocks > 600 else Lags(4, 3, 1, 1) if blocks > 250 else Lags(3, 2, 1, 0)


class Predictor(Frozen):
    """A fitted prediction and all that is needed to ask whether something more explains PV.

    columns: (columns, rows): levels, past PV, past OP, the rest. target, error: (rows,). All three times the root of
    the weights (rows,), so that sums over rows are weighted ones. coefficients, gram: of the columns. past_measurement,
    past_output: where their lags stand among the columns; last_measurement: where means of PV's last few samples do.
    loss: sum of squared errors, of an imperfect model and of OP included. every: how many rows there were for each.
    floor: what that is at least. blur: (columns,) variance of the errors in columns, in parts of their own."""

    size: int
    lags: Lags
    columns: FloatArray
    target: FloatArray
    weights: FloatArray
    error: FloatArray
    coefficients: FloatArray
    gram: FloatArray
    loss: float
    floor: float
    past_measurement: slice
    past_output: slice
    last_measurement: slice
    every: int
    blur: FloatArray
    _used: tuple[int, ...]
    _rows: tuple[NDArray[np.int64], ...]

    @property
    def rows(self) -> int:
        return len(self.target)

    def lagged(self, signals: Sequence[FloatArray], count: int = 0) -> FloatArray:
        """Lags of further signals, (signals, lags, rows), the first `count` of them or all, weighted as the columns.

        signals: (signals, blocks) of each of the recordings that the prediction was made of."""
        parts = [_lags_of(signals[i], self.lags, rows, count) for i, rows in zip(self._used, self._rows, strict=True)]
        together = np.concatenate(parts, axis=2) if len(parts) > 1 else parts[0]
        together *= np.sqrt(self.weights)
        return together

    def since(self, samples: Sequence[IntArray]) -> BoolArray:
        """Rows (questions, rows) that look back, in single blocks, on nothing before samples (questions,) of each of
        the recordings that the prediction was made of."""
        firsts = [-(-samples[i][:, None] // self.size) + self.lags.fine for i in self._used]
        return np.concatenate([rows >= first for rows, first in zip(self._rows, firsts, strict=True)], axis=1)


class Blocks(Frozen):
    """A recording in blocks of `size` samples. means: (5, blocks) of PV, OP, OP squared, OP times PV and PV squared,
    the last three over span of OP or deviation of PV; usable: (blocks,) share of the samples that may be used."""

    recording: Recording
    size: int
    means: FloatArray
    usable: FloatArray

    @property
    def coarser(self) -> "Blocks":
        """The same in blocks of twice the size."""
        return Blocks(self.recording, 2 * self.size, paired(self.means), paired(self.usable))


def in_blocks(r: Recording, size: int, span: float, deviation: float) -> Blocks:
    """Cut a recording into blocks. span: of OP, deviation: of PV, in their units."""
    u, y = r.output, r.measurement
    means = [block_means(values, size) for values in (y, u, u * u / span, u * y / span, y * y / deviation)]
    return Blocks(r, size, np.array(means), block_means(r.usable.astype(float), size))


def block_means(values: FloatArray, size: int) -> FloatArray:
    """Means (blocks,) over whole blocks of `size` samples."""
    count = len(values) // size
    return np.asarray(values[: count * size].reshape(count, size) @ np.full(size, 1.0 / size))


def paired(means: FloatArray) -> FloatArray:
    """Means (.., blocks // 2) over pairs of blocks."""
    return 0.5 * (means[..., :-1:2] + means[..., 1::2])


def predictor(recordings: Sequence[Blocks], deviation: float, most: int, rounding: float = 0.0) -> Predictor | None:
    """Fit the prediction of block means; None where too few blocks can be used.

    deviation: of PV, in its units, not zero; rounding: what recording leaves in means. most: rows; of more, every
    second, third .. is taken, each with all that lies before it. Recordings share one prediction, not the level."""
    lags = lags_for(sum(len(b.usable) for b in recordings))
    whole = [_usable_rows(b, lags) for b in recordings]
    used = [i for i, rows in enumerate(whole) if len(rows) > (LEAST_ROWS if len(recordings) > 1 else 0)]
    total = sum(len(whole[i]) for i in used)
    if total < lags.count * 3 + LEAST_ROWS:
        return None
    every, firsts = -(-total // most), np.cumsum([0, *(len(whole[i]) for i in used)]).tolist()
    # of each recording the rows that are taken; a short one may have none among them
    taken = {i: slice(-first % every, None, every) for i, first in zip(used, firsts, strict=False)
             if -first % every < len(whole[i])}
    levels, linear = min(len(taken), LEVELS), []
    level_of = {i: number * levels // len(taken) for number, i in enumerate(taken)}
    for i, t in taken.items():
        means, rows = recordings[i].means, whole[i][t]
        own = np.repeat(np.eye(levels)[:, level_of[i], None], len(rows), axis=1)
        linear.append(np.vstack([own, _lags_of(means[:2], lags, rows).reshape(2 * lags.count, -1), means[:1, rows]]))
    H = np.concatenate(linear, axis=1)
    output, recent = levels + lags.count, len(_last_lengths(recordings[0].size))
    blur = np.repeat([0.0, RESOLUTION**2], [output, lags.count])
    first = _fitted(H[:-1], H[-1], blur)[0]
    answers = lags.spread(first[levels:].reshape(2, -1))  # of every block, also those that are not taken
    missed = [recordings[i].means[0, whole[i]] - first[level_of[i]] - sum(
        np.convolve(x, c)[whole[i] - 1] for x, c in zip(recordings[i].means[:2], answers, strict=True)) for i in taken]
    limit = SURPRISE * 1.4826 * float(np.median(np.abs(np.concatenate(missed))))
    more = []
    for (i, t), error in zip(taken.items(), missed, strict=True):
        rows = whole[i][t]
        surprises = _surprises(error - np.clip(error, -limit, limit), whole[i], rows)
        # squares and products of PV and OP: a curved valve characteristic, a gain that moves
        counts = (lags.squares, lags.products, lags.products)
        products = [means[rows - k] for means, count in zip(recordings[i].means[2:], counts, strict=True)
                    for k in range(1, count + 1)]
        more.append(np.vstack([_just_before(recordings[i], rows), np.array(products), surprises]))
    y, H = H[-1], np.vstack([H[:-1], np.concatenate(more, axis=1)])
    rest = len(H) - len(blur) - 2 * recent
    blur = np.append(blur, np.repeat([0.0, RESOLUTION**2, 0.0], [recent, recent, rest]))
    H, blur = (x[np.any(H != 0.0, axis=1)] for x in (H, blur))
    if len(y) < max(len(H) + LEAST_ROWS, FEWEST_ROWS):
        return None
    b, w, H, gram = _fitted(H, y, blur)
    y = y * np.sqrt(w)
    error = y - b @ H
    floor = float(np.sum(w)) * ((MODEL_ERROR * deviation) ** 2 + rounding**2)
    latest = output + lags.count
    return Predictor(recordings[0].size, lags, H, y, w, error, b, gram, float(y @ y - b @ (H @ y)) + floor, floor,
                     slice(levels, output), slice(output, latest), slice(latest, latest + recent), every, blur,
                     tuple(taken), tuple(whole[i][t] for i, t in taken.items()))


def _usable_rows(b: Blocks, lags: Lags) -> NDArray[np.int64]:
    """Numbers of the blocks that are complete, as are all that their prediction looks back on."""
    bad = np.cumsum(np.append(0, b.usable < COMPLETE))
    count = len(bad) - 1
    if count <= lags.reach:
        return np.empty(0, dtype=np.int64)
    return np.flatnonzero(bad[lags.reach + 1 :] == bad[: count - lags.reach]) + lags.reach


def _just_before(b: Blocks, rows: NDArray[np.int64]) -> FloatArray:
    """Means of the last 1, 2, size/4 and size/2 samples of PV and OP before each block: what has just happened."""
    lengths = _last_lengths(b.size)
    cut = slice(0, len(b.usable) * b.size)
    signals = [x[cut].reshape(-1, b.size) for x in (b.recording.measurement, b.recording.output)]
    return np.array([x[rows - 1, -n:].mean(axis=1) for x in signals for n in lengths]).reshape(-1, len(rows))


def _lags_of(signals: FloatArray, lags: Lags, rows: NDArray[np.int64], count: int = 0) -> FloatArray:
    """The first `count` lags, or all, of block means (signals, blocks) before the rows, (signals, lags, rows)."""
    from ..kernels import lagged_means
    fine = min(count or lags.fine, lags.fine)
    return np.asarray(lagged_means(signals, rows, fine, (count or lags.count) - fine))


def _last_lengths(size: int) -> list[int]:
    return sorted({1, 2, max(1, size // 4), max(1, size // 2)} - {size}) if size > 1 else []


def _surprises(beyond: FloatArray, of: NDArray[np.int64], rows: NDArray[np.int64]) -> FloatArray:
    """Lags (lags, rows) of what of the prediction error is a surprise, `beyond`, in the blocks `of`."""
    line = np.zeros(of[-1] + 1)
    line[of] = beyond
    total = np.append(0.0, np.cumsum(line))
    single = [line[rows - i] for i in range(1, SURPRISE_LAGS + 1)]
    end = rows - SURPRISE_LAGS
    return np.array([*single, (total[end] - total[np.maximum(end - SURPRISE_SPAN, 0)]) / SURPRISE_SPAN])


def _fitted(H: FloatArray, y: FloatArray, blur: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Of y regressed on H: coefficients (columns,), Student weights (rows,), H times their root, its Gram matrix."""
    w, weighted, variance = np.ones(len(y)), np.empty_like(H), np.inf
    for again in range(ROUNDS + 1):
        root = np.sqrt(w)
        np.multiply(H, root, out=weighted)
        gram = weighted @ weighted.T
        diagonal = np.einsum("ii->i", gram)  # a view
        diagonal *= 1.0 + RIDGE + blur
        diagonal += 1e-12
        b: FloatArray = np.asarray(np.linalg.solve(gram, weighted @ (root * y)), dtype=np.float64)
        error = y - b @ H
        before, variance = variance, float(np.mean(w * error**2))
        if again == ROUNDS or abs(variance - before) < STANDS * variance:
            break
        if not again:
            variance = min(variance, (1.4 * float(np.median(np.abs(error)))) ** 2)
        w = (FREEDOM + 1.0) / (FREEDOM + error**2 / max(variance, 1e-300))
    return b, w, weighted, gram
