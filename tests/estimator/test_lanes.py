"""Sums in stripes and merged products against plain double precision, and their digits in a process of their own."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from backlash_cli.estimator.lanes import STRIPES, add, dot, fma, folded
from tests.benchmarks.random_loops import draw


@settings(deadline=None, max_examples=50)
@given(st.integers(0, 10_000), st.integers(0, 3000))
def test_sums_in_stripes_are_those_of_double_precision(seed: int, n: int):
    rng = np.random.default_rng(seed)
    x, y = rng.normal(size=(2, n)).astype(np.float32)
    assert dot(x, y) == pytest.approx(float(x.astype(float) @ y.astype(float)), abs=2e-6 * max(n, 1))
    z = x.copy()
    add(z, 0.37, y)
    np.testing.assert_allclose(z, x + np.float32(0.37) * y.astype(float), atol=1e-6)


def test_stripes_are_folded_completely():
    assert folded(np.arange(STRIPES, dtype=np.float32)) == STRIPES * (STRIPES - 1) / 2


def test_a_product_goes_into_a_sum_unrounded():
    @numba.njit
    def merged(a: float, b: float, c: float) -> float:
        return float(fma(a, b, c))

    a = 1.0 + 2.0**-30
    assert merged(a, a, -1.0 - 2.0**-29) == 2.0**-60  # rounded first, the square would leave nothing


PROGRAM = """
import pickle, sys
from backlash_cli.estimator.confirm import confirm
found = confirm(pickle.load(sys.stdin.buffer))
print(repr(found.d), found.details)
"""


def test_the_digits_do_not_depend_on_what_is_compiled_when(tmp_path):
    """The first process compiles, the second takes what the first one kept."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    record = pickle.dumps(draw(5, d=0.03, samples=6000).record)
    said = [subprocess.run([sys.executable, "-c", PROGRAM], env=environment, check=True, capture_output=True,
                           input=record) for _ in range(2)]
    assert said[0].stdout == said[1].stdout != b""
