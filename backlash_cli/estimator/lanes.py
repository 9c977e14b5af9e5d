"""Arithmetic in single precision that gives the same digits however it is compiled.

A compiler that may reorder sums and merge products into them does so in its own way in every copy that it makes of a
function, and a report would depend on which copy ran. Here the order is written down: sums run in stripes side by side
and are folded at the end, and a product goes into a sum unrounded where `fma` is written and nowhere else.
"""

from __future__ import annotations

import platform
from typing import Any

import llvmlite.binding as llvm
import numba
import numpy as np
from numba.extending import intrinsic
from numpy.typing import NDArray

STRIPES = 256  # sums side by side: the processor adds sixteen at a time, and each of them has few members
HAS_FMA = platform.machine() not in ("x86_64", "AMD64", "i386", "i686") or bool(llvm.get_host_cpu_features().get("fma"))


def _fma(typing: Any, a: Any, b: Any, c: Any) -> Any:
    """a * b + c for three floats of one kind, rounded once; twice on processors that cannot, where it would be slow."""

    def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return builder.fma(*values) if HAS_FMA else builder.fadd(builder.fmul(values[0], values[1]), values[2])

    return a(a, a, a), code


fma: Any = intrinsic(_fma)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def folded(sums: NDArray[Any]) -> float:
    """The sum of all STRIPES sums; they are overwritten."""
    m = STRIPES // 2
    while m >= 8:
        for i in range(m):
            sums[i] += sums[m + i]
        m //= 2
    total = 0.0
    for i in range(8):
        total += sums[i]
    return total


@numba.njit(cache=True, nogil=True, error_model="numpy")
def dot(x: NDArray[Any], y: NDArray[Any]) -> float:
    """Sum of the products of x and y (numbers,)."""
    sums = np.zeros(STRIPES, dtype=np.float32)
    for begin in range(0, len(x), STRIPES):
        xs, ys = x[begin : begin + STRIPES], y[begin : begin + STRIPES]
        for i in range(len(xs)):
            sums[i] = fma(xs[i], ys[i], sums[i])
    return float(folded(sums))


@numba.njit(cache=True, nogil=True, error_model="numpy")
def add(x: NDArray[Any], share: float, y: NDArray[Any]) -> None:
    """Add `share` times y to x in place."""
    factor = np.float32(share)
    for k in range(len(x)):
        x[k] = fma(factor, y[k], x[k])
