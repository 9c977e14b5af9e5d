"""The prediction of PV and the gaps offered to it, against plain loops and plain regressions."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from backlash_cli.estimator.gap_test import (
    GapTest,
    forgetting_gaps_in,
    gaps_in,
    gaps_tested,
    imitation_gains,
    stem_known,
)
from backlash_cli.estimator.predictor import (
    RESOLUTION,
    Lags,
    Predictor,
    Recording,
    block_means,
    in_blocks,
    lags_for,
    paired,
    predictor,
    recording_of,
)
from backlash_cli.kernels import forgetting_gap_means, gap_crossings, gap_means, play

SIZE = 4


def recording(n: int = 4000, d: float = 3.0, seed: int = 0) -> Recording:
    """OP [%] that wanders, PV one lag behind OP through a gap, and a load that wanders."""
    rng = np.random.default_rng(seed)
    u = np.cumsum(rng.normal(0.0, 0.4, n))
    u -= np.convolve(np.pad(u, 200, mode="edge"), np.ones(401) / 401, mode="valid")
    x, y, load = play(u, d, u[0]), np.zeros(n), np.cumsum(rng.normal(0.0, 0.01, n))
    for k in range(1, n):
        y[k] = y[k - 1] + (1.2 * x[k - 1] - y[k - 1]) / 6.0
    y = y + load + rng.normal(0.0, 0.05, n)
    return Recording(u - u.mean(), y - y.mean(), np.ones(n, dtype=bool))


def prediction(recordings: list[Recording], size: int = SIZE, span: float = 10.0, most: int = 10**6
               ) -> Predictor | None:
    deviation = float(np.std(np.concatenate([r.measurement - r.measurement.mean() for r in recordings])))
    return predictor([in_blocks(r, size, span, deviation) for r in recordings], deviation, most)


def gaps_of(p: Predictor, recordings: list[Recording], widths: np.ndarray) -> GapTest:
    gaps, known = zip(*[(gaps_in(r.output, widths, p.size), stem_known(r.output, widths)) for r in recordings],
                      strict=True)
    return gaps_tested(p, gaps, known, widths, 0.5, 20.0, 1.0)


def plainly_fitted(p: Predictor, columns: np.ndarray, y: np.ndarray, counts: np.ndarray | slice = slice(None),
                   more: float = 1.0) -> tuple[np.ndarray, float]:
    """Coefficients and loss by NumPy's own solver; errors in OP are rows of their own. counts: rows that do. more: such
    errors in further columns."""
    own, recent = np.linalg.norm(p.columns[:, counts], axis=1), p.last_measurement.stop - p.last_measurement.start
    number = np.arange(len(own))
    of_output = np.isin(number, [*number[p.past_output], *(p.last_measurement.stop + np.arange(recent))])
    errors = RESOLUTION * np.append(own * of_output, np.full(len(columns) - len(own), more * own[p.past_output][0]))
    rows, target = np.vstack([columns.T, np.diag(errors)]), np.append(y, np.zeros(len(columns)))
    b, *_ = np.linalg.lstsq(rows, target, rcond=None)
    return b, float(np.sum((target - rows @ b) ** 2))


def test_gap_means_are_those_of_play_at_full_rate():
    u = recording(999).output
    means = gap_means(u, np.array([0.5, 2.0]), 7, len(u) // 7)
    for width, found in zip((0.5, 2.0), means, strict=True):
        low, high = np.minimum.accumulate(u), np.maximum.accumulate(u)
        first = int(np.argmax(high - low >= width))
        middle = 0.5 * (low + high)[:first]  # of where the stem may stand: from max - half the gap to min + half
        stem = np.append(middle, play(u[first:], width, middle[-1]))
        expected = (stem - u)[: len(u) // 7 * 7].reshape(-1, 7).mean(1)
        np.testing.assert_allclose(found, expected, atol=1e-12)


def test_gaps_that_forget_are_those_of_a_plain_loop():
    u = recording(300).output
    found = forgetting_gap_means(u, np.array([9.0, 1.5]), np.array([0.3, 0.1]), 5, 60)[1, 1]
    mean, lag = u[0], []
    for value in u:
        mean += 0.1 * (value - mean)
        lag.append(-np.clip(value - mean, -0.75, 0.75))
    np.testing.assert_allclose(found, np.array(lag).reshape(-1, 5).mean(1), atol=1e-12)


def test_crossings_are_the_changes_of_direction_of_the_stem():
    for seed in range(5):
        u = recording(2000, seed=seed).output
        moved = np.diff(play(u, 1.0, u[0]))
        way = np.sign(moved[moved != 0.0])
        assert gap_crossings(u, 1.0) == np.count_nonzero(np.diff(way))


def test_coefficients_of_far_lags_are_spread_over_their_blocks():
    lags = Lags(2, 2, 0, 0)
    np.testing.assert_allclose(lags.spread(np.array([1.0, 2.0, 4.0, 8.0])), [1, 2, 2, 2, 2, 2, 2, 2])
    assert lags.reach == 9


def test_columns_are_what_lies_before_each_block():
    r = recording(3000)
    p = prediction([r])
    assert p is not None
    lags = lags_for(3000 // SIZE)
    y, u = (v[: 3000 // SIZE * SIZE].reshape(-1, SIZE).mean(1) for v in (r.measurement, r.output))
    row = 17
    block = lags.reach + row
    root = np.sqrt(p.weights[row])
    assert p.target[row] == pytest.approx(root * y[block])
    for values, at in ((y, p.past_measurement), (u, p.past_output)):
        fine = [values[block - i] for i in range(1, lags.fine + 1)]
        far, end, width = [], block - lags.fine, 2
        for _ in range(lags.far):
            far.append(values[end - width : end].mean())
            end, width = end - width, 2 * width
        np.testing.assert_allclose(p.columns[at, row], root * np.array([*fine, *far]))


def test_means_over_pairs_of_blocks_are_those_of_blocks_twice_as_long():
    r = recording(3001)
    np.testing.assert_allclose(paired(block_means(r.output, 5)), block_means(r.output, 10), atol=1e-12)
    fine, coarse = in_blocks(r, 5, 10.0, 2.0).coarser, in_blocks(r, 10, 10.0, 2.0)
    np.testing.assert_allclose(fine.means, coarse.means, atol=1e-12)
    assert fine.size == coarse.size and fine.usable.tolist() == coarse.usable.tolist()


def test_a_thinned_prediction_has_every_second_row_with_the_same_past():
    every, second = prediction([recording()]), prediction([recording()], most=600)
    assert every is not None and second is not None
    linear = slice(0, every.past_output.stop)
    thin, whole = ((p.columns[linear] / np.sqrt(p.weights), p.target / np.sqrt(p.weights)) for p in (second, every))
    np.testing.assert_allclose(thin[0], whole[0][:, ::2], atol=1e-12)
    np.testing.assert_allclose(thin[1], whole[1][::2])


@pytest.mark.parametrize("before", range(1200, 1280, 8))
def test_a_recording_so_short_that_no_row_of_it_is_taken_is_left_out(before: int):
    r = recording(6000)
    cuts = [slice(0, before), slice(before, before + 210), slice(before + 210, None)]
    parts = [Recording(r.output[c], r.measurement[c], r.usable[c]) for c in cuts]
    p = prediction(parts, most=100)
    assert p is not None and p.rows <= 100
    assert p.lagged([gaps_in(c.output, np.array([2.0]), SIZE) for c in parts]).shape[2] == p.rows


def test_the_gain_of_free_lags_is_that_of_a_plain_regression():
    r = recording()
    p = prediction([r])
    assert p is not None
    gaps = forgetting_gaps_in(r.output, np.array([2.0, 4.0]), SIZE, 20.0)
    floor = p.loss - plainly_fitted(p, p.columns, p.target)[1]
    assert 0.0 < floor < 0.1 * p.loss
    for j, found in enumerate(imitation_gains(p, [gaps])):
        columns = np.vstack([p.columns, p.lagged([gaps], 4)[j]])
        left = floor + plainly_fitted(p, columns, p.target)[1]
        free = p.rows - len(p.columns)
        assert found == pytest.approx(0.5 * free * np.log(p.loss / left), rel=1e-3, abs=0.02)


@pytest.mark.parametrize("parts", [1, 3])
def test_the_gain_of_a_gap_is_that_of_two_plain_regressions_on_the_rows_where_the_stem_is_known(parts):
    """Weighted least squares of a plain kind, with and without the column that the tied fit predicts."""
    several = [recording(4000 // parts, seed=k) for k in range(parts)]
    p = prediction(several)
    assert p is not None
    widths = np.array([3.0, 8.0])
    found = gaps_of(p, several, widths)
    floor = p.loss - plainly_fitted(p, p.columns, p.target)[1]
    G = p.lagged([gap_means(r.output, widths, SIZE, len(r.output) // SIZE) for r in several])
    reach, fine = p.lags.reach, p.lags.fine
    for j, width in enumerate(widths):
        counts = []
        for r in several:
            first = next(k for k in range(len(r.output)) if np.ptp(r.output[: k + 1]) >= 0.9 * width)
            counts += [(b - fine) * SIZE >= first for b in range(reach, len(r.output) // SIZE)]
        rows = np.array(counts)
        assert np.count_nonzero(~rows) < 0.5 * len(rows)
        assert width == 3.0 or np.count_nonzero(~rows) > 20
        y, before, share = p.target[rows], p.columns[:, rows], p.weights[rows].sum() / p.weights.sum()
        free = len(y) - len(before)

        def loss(columns: np.ndarray, more: float = 0.0, y: np.ndarray = y, rows: np.ndarray = rows,
                 share: float = share) -> tuple[float, np.ndarray]:
            b, left = plainly_fitted(p, columns, y, rows, more)
            return left + floor * share, b

        without, _ = loss(before)
        tied = before.copy()
        tied[p.past_output] += G[j][:, rows]
        with_gap, b = loss(tied)
        assert found.tied_gain[j] == pytest.approx(0.5 * free * np.log(without / with_gap), rel=1e-3, abs=0.02)
        answer = b[p.past_output]
        left, both = loss(np.vstack([before, answer @ G[j][:, rows]]), more=float(np.linalg.norm(answer)))
        assert found.gain[j] == pytest.approx(0.5 * free * np.log(without / left), rel=1e-3)
        assert found.share[j] == pytest.approx(both[-1], rel=1e-3)


@pytest.mark.parametrize("K", [0.5, -0.5, None])
def test_an_answer_of_its_own_is_that_of_a_plain_regression_and_counts_where_a_process_could_give_it(K):
    """The fitted difference equation is stepped block by block, as a program on a first day would."""
    r, widths = recording(), np.array([1.0, 3.0, 4.5])
    p = prediction([r])
    assert p is not None
    gaps = gaps_in(r.output, widths, SIZE)
    found = gaps_tested(p, [gaps], [stem_known(r.output, widths)], widths, K, 20.0, 1.0)
    Ti, seen = 20 // SIZE, []
    for j, gain in enumerate(imitation_gains(p, [gaps])):
        columns = np.vstack([p.columns, p.lagged([gaps], 4)[j]])
        b, _ = plainly_fitted(p, columns, p.target)
        past = list(b[p.past_measurement][: p.lags.fine])
        for k, mean in enumerate(b[p.past_measurement][p.lags.fine :]):
            past += [mean / 2 ** (k + 1)] * 2 ** (k + 1)
        past[0] += b[p.last_measurement].sum()
        pv: list[float] = []
        for t in range(1, 3 * Ti + 1):  # the gap steps by one just before the first block
            pv.append(sum(c * pv[-i] for i, c in enumerate(past, 1) if i <= len(pv)) + b[-4:][:t].sum())
        answer = (K or np.sign(pv[Ti - 1])) * np.array(pv)
        seen.append(bool(answer.max() > -answer.min() and answer[Ti - 1] > 0 and (K is None or answer.max() > 0.02)))
        assert found.free[j] == pytest.approx(gain if seen[-1] else -1.0)
    assert seen[1] is (K != -0.5)


def test_the_stem_is_known_once_op_has_covered_the_gap_wherever_it_stood():
    u = recording(400).output
    widths = np.array([0.5, 2.0, 3.0, 500.0])
    known, means = stem_known(u, widths), gap_means(u, widths, 1, len(u))
    assert known[-1] == len(u)
    for width, first, lag in zip(widths[:-1], known, means, strict=False):
        low, high = (play(u, width, u[0] + side * width / 2) for side in (-1, 1))
        assert np.all(high[first:] - low[first:] <= 0.1 * width + 1e-9)
        assert high[first - 1] - low[first - 1] > 0.1 * width
        assert np.all(u + lag >= low - 1e-9) and np.all(u + lag <= high + 1e-9)


def test_many_short_recordings_tell_a_gap_that_stood_anywhere_when_they_began():
    """OP needs a fifth of each recording to cover the gap."""
    long = recording(12000, d=5.0, seed=3)
    pieces = [Recording(*(x[k : k + 400] for x in (long.output, long.measurement, long.usable)))
              for k in range(0, 12000, 400)]
    p = prediction(pieces)
    assert p is not None
    widths = np.array([2.5, 3.5, 5.0, 7.0])
    waits = [stem_known(r.output, widths[2:3])[0] for r in pieces]
    assert np.mean(waits) > 70
    found = gaps_of(p, pieces, widths)
    assert int(found.answer.argmax()) == 2
    assert found.share[2] == pytest.approx(1.0, abs=0.1)
    guessed = gaps_tested(p, [gaps_in(r.output, widths, SIZE) for r in pieces], [np.zeros(4, int)] * 30, widths, 0.5,
                          20.0, 1.0)
    assert found.gain[2] > 1.1 * guessed.gain[2]


def test_a_gap_is_answered_in_full_at_its_width_and_imitations_gain_less():
    r = recording()
    p = prediction([r])
    assert p is not None
    widths = np.array([1.0, 2.0, 3.0, 4.5])
    found = gaps_of(p, [r], widths)
    assert int(found.answer.argmax()) == 2
    assert found.share[2] == pytest.approx(1.0, abs=4.0 * found.deviation[2] + 0.05)
    assert found.gain[2] > 3.0 * imitation_gains(p, [forgetting_gaps_in(r.output, widths, SIZE, 20.0)]).max()


def test_without_a_gap_nothing_is_gained():
    r = recording(d=0.0)
    p = prediction([r])
    assert p is not None
    assert float(gaps_of(p, [r], np.array([1.0, 3.0])).gain.max()) < 8.0


def test_recordings_of_one_loop_are_pooled_each_at_its_own_level():
    parts = [recording(900, seed=k) for k in range(4)]
    far = [Recording(r.output, r.measurement + 10.0 * k, r.usable) for k, r in enumerate(parts)]
    widths = np.array([1.0, 3.0])
    gains = []
    for several in (parts, far):
        p = prediction(several)
        assert p is not None
        gains.append(gaps_of(p, several, widths).gain[1])
    alone = prediction(parts[:1])
    assert alone is not None
    assert gains[0] > 2.0 * gaps_of(alone, parts[:1], widths).gain[1]
    assert gains[1] == pytest.approx(gains[0], rel=0.2)


def test_of_very_many_recordings_neighbours_share_a_level():
    long = recording(36000, seed=2)
    pieces = [Recording(*(x[k : k + 300] for x in (long.output, long.measurement, long.usable)))
              for k in range(0, 36000, 300)]
    p = prediction(pieces)
    assert p is not None and p.past_measurement.start == 50
    levels = p.columns[:50] / np.sqrt(p.weights)
    assert np.all(levels.sum(axis=0) == pytest.approx(1.0)) and np.ptp(levels.sum(axis=1)) <= 2 * p.rows / 120
    found = gaps_of(p, pieces, np.array([1.5, 3.0, 6.0]))
    assert int(found.answer.argmax()) == 1 and found.share[1] == pytest.approx(1.0, abs=0.1)


def test_too_few_blocks_are_no_prediction():
    assert prediction([recording(200)]) is None


def test_a_recording_holds_op_and_draws_pv_straight_between_usable_samples():
    index = np.array([7, 8, 10, 12])
    found = recording_of(index, np.array([np.nan, 2.0, 3.0, np.nan]), np.array([1.0, 99.0, 4.0, 8.0]),
                         np.array([True, False, True, True]))
    assert found.usable.tolist() == [True, False, False, True, False, True]
    assert found.output.tolist() == [2.0, 2.0, 2.0, 3.0, 3.0, 3.0]  # before the first known one, that one
    assert found.measurement.tolist() == pytest.approx([1.0, 2.0, 3.0, 4.0, 6.0, 8.0])


def test_a_gap_that_op_never_crosses_is_not_answered_whatever_pv_does():
    r = recording(3000)
    p = prediction([r], 5, 30.0, 6000)
    assert p is not None
    span = float(np.ptp(r.output))
    with np.errstate(all="raise"):
        found = gaps_of(p, [r], np.array([3.0, 30.0]) * span)
    assert found.share.tolist() == found.gain.tolist() == [0.0, 0.0] and not found.possible.any()
    assert np.all(found.deviation > 1e3)


@pytest.mark.parametrize("seed", range(4))
def test_an_op_of_two_levels_tells_nothing_of_a_gap(seed: int):
    """The stem behind the gap has two levels as well: a process with another gain, but for the very first step."""
    rng = np.random.default_rng(seed)
    op = np.repeat(np.where(np.arange(200) % 2, 30.0, -30.0), rng.integers(20, 90, 200))
    stem = play(op, 3.0, op[0])
    pv = lfilter([0.0, 0.03], [1.0, -0.97], stem) + np.cumsum(rng.normal(0.0, 0.1, len(op)))
    recordings = [Recording(op, pv, np.ones(len(op), dtype=bool))]
    p = prediction(recordings, span=60.0)
    assert p is not None
    found = gaps_of(p, recordings, np.array([1.0, 3.0, 8.0]))
    assert np.all(np.abs(found.share) < 1.5 * found.deviation)
