"""One period that dominates PV, in a whole record and in one of pieces."""

from __future__ import annotations

import numpy as np
import pytest

from backlash_cli.estimator.periodic import _left, _refined, periodic_load

WHOLE = np.arange(1600)
PIECES = np.concatenate([np.arange(k, k + 250) for k in (0, 2250, 3000, 7750, 8000, 11_500, 14_250, 16_750)])


def swing(at: np.ndarray, period: float) -> np.ndarray:
    return np.asarray(0.5 + 0.02 * np.sin(2 * np.pi * at / period + 0.7))


@pytest.mark.parametrize("at", [WHOLE, PIECES])
@pytest.mark.parametrize("period", [61.3, 97.0, 158.8])
def test_the_shapes_explain_the_swing(at: np.ndarray, period: float) -> None:
    y = swing(at, period) + 0.003 * np.random.default_rng(1).normal(size=len(at))
    shapes = periodic_load(y, at)
    assert shapes.shape == (2, len(at))
    left = y - y.mean() - np.linalg.lstsq(shapes.T, y - y.mean(), rcond=None)[0] @ shapes
    assert np.std(left) < 0.0035


@pytest.mark.parametrize("at", [WHOLE, PIECES])
@pytest.mark.parametrize("y", [
    lambda at: np.random.default_rng(2).normal(size=at[-1] + 1).cumsum()[at],
    lambda at: swing(at, 97.0) + 0.02 * np.random.default_rng(3).normal(size=len(at)),
    lambda at: np.sign(swing(at, 97.0) - 0.5) * np.exp(-(at % 48.5) / 10.0),
    lambda at: swing(at, 2.5 * at[-1]),
])
def test_nothing_else_is_taken_for_one(at: np.ndarray, y) -> None:
    assert periodic_load(y(at), at).shape == (0, len(at))


def test_a_swing_that_drifts_in_phase_is_none_in_pieces() -> None:
    y = np.sin(2 * np.pi * PIECES / 97.0 + 4.0 * np.sin(PIECES / 3000.0))
    assert len(periodic_load(y, PIECES)) == 0


@pytest.mark.parametrize("start", [0, 10**7])
def test_the_refined_frequency_leaves_least(start: int) -> None:
    """Against a fit of every frequency of the grid by itself, also far from the first row and with holes."""
    rng = np.random.default_rng(start)
    at = start + np.cumsum(np.where(rng.random(1500) < 0.02, rng.integers(2, 400, 1500), 1))
    width = 1.0 / (at[-1] - at[0])
    for frequency in (0.02, 0.11):
        y = np.sin(2.0 * np.pi * (frequency + 0.37 * width) * at) + 0.5 * rng.normal(size=len(at))
        found = _refined(frequency, width, y, at)
        assert abs(found - frequency) <= width
        grid = frequency + width * np.linspace(-1.0, 1.0, 41)
        assert _left(found, y, at) == pytest.approx(min(_left(f, y, at) for f in grid), rel=1e-9)
