"""Order statistics of values in pieces are those of the values together; distances counted in pieces likewise."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from backlash_cli.loaders import ranks
from backlash_cli.loaders.ranks import StreamValues
from backlash_cli.loaders.scaling import ArrayValues
from backlash_cli.loaders.steps import Steps, StepTally

NUMBERS = st.one_of(st.sampled_from([0.0, -0.0, 1.0, -3.5, 7e300, -1e-300, float("nan")]), st.floats(-1e6, 1e6))


@given(st.lists(NUMBERS, min_size=1, max_size=80), st.integers(1, 30), st.sampled_from([0, 3, 1 << 20]))
@settings(max_examples=150, deadline=None)
def test_quantiles_of_a_stream_are_exact(numbers, size, few):
    values = np.array([*numbers, 2.0])
    stream = StreamValues(lambda: (values[k : k + size] for k in range(0, len(values), size)))
    whole = ArrayValues(values)
    shares = [0.0, 0.001, 0.05, 0.3, 0.5, 0.75, 1.0]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ranks, "FEW", few)
        assert stream.ends == whole.ends
        assert stream.quantiles(shares) == whole.quantiles(shares)
        inside = stream.within(-1.0, 5.0)
        assert inside.ends == whole.within(-1.0, 5.0).ends
        assert inside.quantiles(shares[::2]) == whole.within(-1.0, 5.0).quantiles(shares[::2])
    known = np.sort(values[np.isfinite(values)])
    np.testing.assert_allclose(stream.quantiles([0.3]), np.quantile(known, 0.3), rtol=1e-12, atol=1e-12)


@given(st.lists(st.integers(1, 50) | st.integers(1, 10**7), min_size=1, max_size=80), st.integers(1, 30))
@settings(max_examples=100, deadline=None)
def test_distances_are_counted_alike_in_pieces(distances, size):
    stamps = 1_773_734_400_000_000 + np.cumsum([0, *distances])
    tally = StepTally()
    for k in range(0, len(stamps), size):
        tally.add(stamps[k : k + size])
    found, whole, steps = tally.steps(), Steps.of(stamps), np.diff(stamps)
    for name in ("values", "counts", "first", "last", "before_longest", "total", "longest", "median"):
        np.testing.assert_array_equal(getattr(found, name), getattr(whole, name))
    assert tally.rising and found.before_longest == stamps[np.argmax(steps)]
    assert found.median == np.median(steps)
    for share in (0.1, 0.5, 0.95, 0.99):
        assert found.quantile(share) == float(np.quantile(steps, share))
