"""Compiled loops over rows against the same in plain numpy, number for number."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from backlash_cli.estimator.profile import between
from backlash_cli.estimator.row_loops import from_start, joined
from backlash_cli.estimator.rows import begins


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 10_000), st.floats(0.0, 0.5))
def test_rows_are_counted_from_where_their_stretch_begins(seed: int, share: float) -> None:
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(4, 300))
    use = np.flatnonzero(rng.random(300) < 0.6)
    first = rng.random(len(use)) < share
    first[:1] = True
    np.testing.assert_array_equal(from_start(x, use, first), x[:, use] - x[:, use[begins(first)]])


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 10_000), st.floats(1.01, 1.99))
def test_lines_meet_where_the_neighbours_say(seed: int, d: float) -> None:
    before, below, above, after = np.random.default_rng(seed).normal(size=(4, 200))
    chord = below + (above - below) * (d - 1.0)
    left, right = below + (below - before) * (d - 1.0), above - (after - above) / 1.5 * (2.0 - d)
    bends_down = (below - before) > (after - above) / 1.5
    expected = np.where(bends_down, np.maximum(np.minimum(left, right), chord),
                        np.minimum(np.maximum(left, right), chord))
    np.testing.assert_allclose(joined(before, below, above, after, (0.0, 1.0, 2.0, 3.5), d), expected, atol=1e-12)


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 10_000), st.floats(0.011, 0.079))
def test_between_two_widths_a_chain_of_lines_is_met_exactly(seed: int, d: float) -> None:
    """One bend at most between neighbours, as behind a gap; where no wider neighbour is known, never beyond a chord."""
    rng = np.random.default_rng(seed)
    widths = np.array([0.01, 0.02, 0.04, 0.08])
    bend, slope, turned = rng.uniform(0.02, 0.04, 50), *rng.normal(size=(2, 50))

    def position(width: float) -> np.ndarray:
        return slope * np.minimum(width, bend) + turned * np.maximum(width - bend, 0.0)

    x = np.array([position(w) for w in (0.0, *widths)])
    found = between(x, widths, d)
    if d < 0.04:
        np.testing.assert_allclose(found, position(d), atol=1e-12)
    else:
        chord = x[3] + (x[4] - x[3]) * (d - 0.04) / 0.04
        assert np.all(np.minimum(chord, position(d)) - 1e-12 <= found)
        assert np.all(found <= np.maximum(chord, position(d)) + 1e-12)
