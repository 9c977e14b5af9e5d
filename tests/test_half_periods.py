"""Half periods: filters against the state-space discretisation, the cutting against a walk sample by sample, and all of
it against both, for any states, holes and block cuts."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal

from backlash_cli.estimator.haegglund import TOO_SHORT, detect_oscillation, error_scanner, estimate
from backlash_cli.half_periods import Segments, double_lag, segment
from backlash_cli.record import LoopSettings, Record, SampleState

HIDDEN = (SampleState.MISSING, SampleState.IMPLAUSIBLE)


@given(T=st.floats(0.05, 500), h=st.floats(0.01, 60))
def test_coefficients_equal_the_exact_discretisation_of_the_state_space(T, h):
    A, B = np.array([[-1 / T, 0], [1 / T, -1 / T]]), np.array([[1 / T], [0]])
    discrete = signal.cont2discrete((A, B, np.array([[0, 1.0]]), np.zeros((1, 1))), h)
    numerator, denominator = signal.ss2tf(*discrete[:4])
    ours = double_lag(T, h)
    np.testing.assert_allclose(ours.denominator, denominator, atol=1e-12)
    np.testing.assert_allclose(ours.numerator, numerator[0], atol=1e-9)


def test_step_response_is_the_closed_form_at_every_sample():
    T, h = 3.0, 0.7
    stage = double_lag(T, h)
    out, _ = stage.run(np.ones(50), stage.settled(0.0))
    t = h * np.arange(50)
    np.testing.assert_allclose(out, 1 - (1 + t / T) * np.exp(-t / T), atol=1e-12)


def test_settled_filter_stays_at_rest():
    stage = double_lag(2.0, 1.0)
    out, _ = stage.run(np.full(20, 0.37), stage.settled(0.37))
    np.testing.assert_allclose(out, 0.37, rtol=1e-13)


def test_time_constant_zero_is_the_identity():
    values = np.random.default_rng(0).normal(size=9)
    stage = double_lag(0.0, 1.0)
    np.testing.assert_array_equal(stage.run(values, stage.settled(0.0))[0], values)


@pytest.mark.parametrize("T, h", [(1.0, 0.0), (-1.0, 1.0)])
def test_impossible_times_are_refused(T, h):
    with pytest.raises(ValueError):
        double_lag(T, h)


def walk(e, sp, index):
    """Return half periods (begin, end, area, peak, sign, move, complete) by brute force on one stretch at a time."""
    out, i = [], 0
    while i < len(e):
        j = i
        while j + 1 < len(e) and index[j + 1] == index[j] + 1:
            j += 1
        out += _walk_stretch(e[i : j + 1], sp[i : j + 1], index[i])
        i = j + 1
    return out


def _walk_stretch(e, sp, offset):
    signs, last = [], 0
    for v in e:
        last = int(np.sign(v)) or last
        signs.append(last)
    result = []
    begin, crossed, area, peak, move, sign = float(offset), False, 0.0, abs(e[0]), 0.0, signs[0]
    for k in range(1, len(e)):
        if signs[k] != signs[k - 1] and signs[k - 1] != 0:
            f = e[k - 1] / (e[k - 1] - e[k])
            area += 0.5 * abs(e[k - 1]) * f
            result.append((begin, offset + k - 1 + f, area, peak, sign, move, crossed))
            begin, crossed, area, peak = offset + k - 1 + f, True, 0.5 * abs(e[k]) * (1 - f), abs(e[k])
            move, sign = abs(sp[k] - sp[k - 1]), signs[k]
        else:
            area += 0.5 * (abs(e[k - 1]) + abs(e[k]))
            peak, move, sign = max(peak, abs(e[k])), move + abs(sp[k] - sp[k - 1]), signs[k]
    result.append((begin, offset + len(e) - 1.0, area, peak, sign, move, False))
    return [r for r in result if r[4] != 0]


def run(e, sp, index, cuts):
    parts, left = [], None
    for a, b in zip([0, *cuts], [*cuts, len(e)], strict=True):
        done, left, _ = segment(e[a:b], sp[a:b], index[a:b], left)
        parts.append(done)
    return Segments.join([*parts, *([] if left is None else [left.ended()])])


@st.composite
def records(draw):
    n = draw(st.integers(1, 60))
    values = st.sampled_from([-2.0, -1.0, -0.5, 0.0, 0.25, 1.0, 3.0])
    e = np.array(draw(st.lists(values, min_size=n, max_size=n)))
    sp = np.array(draw(st.lists(values, min_size=n, max_size=n)))
    jumps = draw(st.lists(st.sampled_from([1, 1, 1, 1, 1, 2, 7]), min_size=n, max_size=n))
    cuts = sorted(draw(st.lists(st.integers(0, n), max_size=5)))
    return e, sp, np.cumsum(jumps).astype(np.int64), cuts


@given(records())
@settings(max_examples=400, deadline=None)
def test_any_cut_gives_what_a_walk_over_the_samples_gives(record):
    e, sp, index, cuts = record
    found = run(e, sp, index, cuts)
    expected = walk(e, sp, index)
    assert len(found) == len(expected)
    got = np.column_stack([found.begin, found.end, found.area, found.e_max, found.direction,
                           found.setpoint_move, found.complete])
    np.testing.assert_allclose(got, np.array(expected, float).reshape(-1, 7), atol=1e-12)


def test_a_sine_has_half_periods_of_known_length_and_area():
    period, amplitude = 40.0, 0.3
    k = np.arange(400)
    e = amplitude * np.sin(2 * np.pi * (k + 0.25) / period)
    s = run(e, np.zeros(400), k.astype(np.int64), [])
    whole = s.select(s.complete)
    np.testing.assert_allclose(whole.end - whole.begin, period / 2, atol=0.01)
    np.testing.assert_allclose(whole.area, amplitude * period / np.pi, rtol=0.003)


def made(seed: int, n: int = 400, Tf: float | None = None) -> Record:
    """A record with every kind of state, holes in time, numbers that are none, and a moving setpoint."""
    rng = np.random.default_rng(seed)
    state = np.repeat(rng.choice(len(SampleState), size=n, p=[0.7, 0.1, 0.04, 0.04, 0.04, 0.04, 0.04]), 5)[:n]
    index = np.cumsum(rng.choice([1, 2, 5], size=n, p=[0.97, 0.02, 0.01])).astype(np.int64) + 7
    pv = np.cumsum(rng.normal(0, 0.01, n)) + rng.normal(0, 0.02, n)
    sp = np.repeat(rng.normal(0, 0.02, n // 50), 50)
    pv[rng.random(n) < 0.01] = np.nan
    sp[rng.random(n) < 0.01] = np.nan
    pv[100:110] = sp[100:110] = 0.0  # exact zeros of the error where the filter is the identity
    return Record("a", 0.0, 1.0, index, sp, pv, None, state.astype(np.uint8), LoopSettings(K=1.0, Ti=6.0, Tf=Tf))


def by_hand(record: Record, smooth: bool) -> list[tuple[float, ...]]:
    """Half periods of one error, each stretch of known samples filtered by scipy from rest."""
    known = ~np.isin(record.state, HIDDEN) & np.isfinite(record.measurement)
    at, pv, sp, state = (x[known] for x in (record.index, record.measurement, record.setpoint, record.state))
    scanner = error_scanner(record.settings, record.interval)
    filtered = pv.copy()
    edges = [0, *(np.flatnonzero(np.diff(at) != 1) + 1), len(at)]
    for first, last in pairwise(edges):
        for stage in scanner.stages[: 1 + smooth]:
            rest = stage.settled(pv[first])
            filtered[first:last] = signal.lfilter(stage.numerator, stage.denominator, filtered[first:last], zi=rest)[0]
    use = (state <= SampleState.FILLED) & np.isfinite(sp)
    return walk((sp - filtered)[use], sp[use], at[use])


@st.composite
def mostly_clean(draw: st.DrawFn) -> Record:
    """A record of long pieces without hole or doubt, a few of both, and a setpoint that rests or moves."""
    rng = np.random.default_rng(draw(st.integers(0, 10_000)))
    n = draw(st.integers(500, 4000))
    index = np.arange(n, dtype=np.int64) + 3
    state = np.where(rng.random(n) < 0.1, SampleState.FILLED, SampleState.GOOD).astype(np.uint8)
    pv = 0.5 + np.cumsum(rng.normal(0, 0.01, n)) + rng.normal(0, 0.02, n)
    sp = np.full(n, 0.5)
    moved = draw(st.sampled_from(["rests", "steps", "ramps"]))
    if moved == "steps":
        sp[n // 3 :] = 0.6
    elif moved == "ramps":
        sp += 0.001 * np.arange(n)
    for at in draw(st.lists(st.integers(0, n - 1), max_size=4)):
        kind = rng.integers(3)
        if kind == 0:
            index[at:] += rng.integers(1, 40)
        elif kind == 1:
            state[at : at + 20] = SampleState.MANUAL
        else:
            pv[at] = np.nan
    return Record("a", 0.0, 1.0, index, sp, pv, None, state, LoopSettings(K=1.0, Ti=20.0))


@given(mostly_clean(), st.lists(st.integers(0, 4000), max_size=3), st.sampled_from([None, 0.0]))
@settings(max_examples=60, deadline=None)
def test_pieces_without_doubt_are_walked_the_same(record, cuts, Tf):
    record = replace(record, settings=replace(record.settings, Tf=Tf))
    scanner = scanned(record, [min(cut, len(record)) for cut in cuts])
    for track, smooth in ((scanner.plain, False), (scanner.smooth, True)):
        expected = np.array(by_hand(record, smooth)).reshape(-1, 7)
        np.testing.assert_allclose(table(track.finish()), expected, rtol=1e-9, atol=1e-8)


@given(st.integers(0, 10_000), st.lists(st.integers(0, 3000), max_size=3))
@settings(max_examples=20, deadline=None)
def test_errors_of_exactly_zero_belong_to_the_half_period_before(seed, cuts):
    rng = np.random.default_rng(seed)
    steps = np.where(rng.random(3000) < 0.1, rng.choice([-1.0, 1.0], 3000), 0.0)
    pv = 0.5 + np.abs(np.cumsum(steps) - 3.0) / 8.0 - 0.5
    record = Record("a", 0.0, 1.0, np.arange(3000), np.full(3000, 0.5), pv, None, np.zeros(3000, np.uint8),
                    LoopSettings(K=1.0, Ti=20.0, Tf=0.0))
    expected = np.array(by_hand(record, False)).reshape(-1, 7)
    np.testing.assert_allclose(table(scanned(record, cuts).plain.finish()), expected, rtol=1e-9, atol=1e-12)


def table(s: Segments) -> np.ndarray:
    return np.column_stack([s.begin, s.end, s.area, s.e_max, s.direction, s.setpoint_move, s.complete])


def scanned(record: Record, cuts: list[int], *, every: bool = True):
    scanner = error_scanner(record.settings, record.interval, every=every)
    for first, last in pairwise([0, *sorted(cuts), len(record)]):
        scanner.update(record.slice(first, last))
    return scanner


@given(st.integers(0, 10_000), st.lists(st.integers(0, 400), max_size=6), st.sampled_from([None, 0.0]))
@settings(max_examples=60, deadline=None)
def test_both_errors_are_those_of_the_library_filter_for_any_cut(seed, cuts, Tf):
    record = made(seed, Tf=Tf)
    scanner = scanned(record, cuts)
    for track, smooth in ((scanner.plain, False), (scanner.smooth, True)):
        expected = np.array(by_hand(record, smooth)).reshape(-1, 7)
        np.testing.assert_allclose(table(track.finish()), expected, atol=1e-9)


def test_numbers_of_any_kind_and_stride_give_the_same():
    record = made(3)
    wide = np.zeros((len(record), 3), dtype=np.float32)
    wide[:, 1], wide[:, 2] = record.setpoint, record.measurement
    odd = replace(record, setpoint=wide[:, 1], measurement=wide[:, 2], index=record.index.astype(np.int32))
    even = replace(record, setpoint=wide[:, 1].astype(float), measurement=wide[:, 2].astype(float))
    np.testing.assert_array_equal(table(scanned(odd, []).smooth.finish()), table(scanned(even, []).smooth.finish()))


@pytest.mark.parametrize("seed", range(5))
def test_what_is_left_out_matters_to_no_estimate_and_no_oscillation(seed):
    record = made(seed, 20_000)
    record = replace(record, settings=replace(record.settings, Ti=3.0), measurement=0.2 * record.measurement)
    every, some = scanned(record, []), scanned(record, [5000, 5001], every=False)
    a, b = (estimate(s.smooth.finish(), 1.0, record.settings) for s in (every, some))
    long = a.why != TOO_SHORT
    assert some.smooth.left_out > 0 and len(a) == len(b) + some.smooth.left_out
    np.testing.assert_allclose(a.d[long], b.d[b.why != TOO_SHORT], rtol=1e-9)
    assert some.plain.left_out > 0
    assert detect_oscillation(every.plain.finish(), 1.0, 3.0) == detect_oscillation(some.plain.finish(), 1.0, 3.0)
