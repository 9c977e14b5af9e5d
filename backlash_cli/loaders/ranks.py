"""Order statistics of more values than memory should hold, found by going through them a few times."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from .scaling import quantile

Stream = Callable[[], Iterator[NDArray[np.float64]]]
DIGIT = 16  # bits that are settled by going through the values once
FEW = 1 << 20  # values that may be looked at together
_SIGN = np.uint64(1 << 63)


class StreamValues:
    """Finite values of a signal, given anew each time they are asked for; others are passed over."""

    def __init__(self, stream: Stream, low: float = -np.inf, high: float = np.inf) -> None:
        self._stream, self._low, self._high = stream, low, high
        self._ends: tuple[float, float] | None = None
        self._count = -1

    def __iter__(self) -> Iterator[NDArray[np.float64]]:
        for values in self._stream():
            keep = np.isfinite(values) & (values >= self._low) & (values <= self._high)
            yield values if keep.all() else values[keep]

    @property
    def count(self) -> int:
        """Number of values."""
        if self._count < 0:
            self._count = 0
            for values in self:
                self._count += len(values)
                if len(values):
                    low, high = self._ends or (np.inf, -np.inf)
                    self._ends = min(low, float(values.min())), max(high, float(values.max()))
        return self._count

    @property
    def ends(self) -> tuple[float, float] | None:
        return self._ends if self.count else None

    def quantiles(self, shares: list[float]) -> list[float]:
        last = self.count - 1
        ranks = sorted({min(int(share * last) + k, last) for share in shares for k in (0, 1)})
        at = dict(zip(ranks, order_statistics(self.__iter__, ranks), strict=True))
        return [quantile(at.__getitem__, self.count, share) for share in shares]

    def within(self, low: float, high: float) -> StreamValues:
        return StreamValues(self._stream, max(low, self._low), min(high, self._high))


def order_statistics(stream: Stream, ranks: Sequence[int]) -> list[float]:
    """Return the values of these ranks, counted from 0, exactly.

    The bits of a number are settled from the highest on, some more each time the values are gone through.
    """
    known = [np.uint64(0)] * len(ranks)  # bits settled so far, by rank
    left = list(ranks)  # rank among the values that share them
    for settled in range(0, 64, DIGIT):
        shift = np.uint64(64 - DIGIT - settled)
        counts = {prefix: np.zeros(1 << DIGIT, np.int64) for prefix in known}
        for values in stream():
            keys = _keys(values)
            for prefix, count in counts.items():
                here = keys if not settled else keys[keys >> (shift + np.uint64(DIGIT)) == prefix]
                digits = (here >> shift) & np.uint64((1 << DIGIT) - 1)
                count += np.bincount(digits.astype(np.int64), minlength=1 << DIGIT)
        alike: dict[np.uint64, int] = {}
        for place, prefix in enumerate(known):
            below = np.cumsum(counts[prefix])
            digit = int(np.searchsorted(below, left[place], side="right"))
            left[place] -= int(below[digit - 1]) if digit else 0
            known[place] = np.uint64((int(prefix) << DIGIT) | digit)
            alike[known[place]] = int(counts[prefix][digit])
        if shift and sum(alike.values()) <= FEW:
            return _among(stream, known, left, shift)
    bits = np.array(known, np.uint64)
    return np.where(bits & _SIGN, bits ^ _SIGN, ~bits).view(np.float64).tolist()


def _among(stream: Stream, known: Sequence[np.uint64], left: Sequence[int], shift: np.uint64) -> list[float]:
    """The values of these ranks among those that begin with the bits known."""
    found: dict[np.uint64, list[NDArray[np.float64]]] = {prefix: [] for prefix in known}
    for values in stream():
        begin = _keys(values) >> shift
        for prefix, kept in found.items():
            kept.append(values[begin == prefix])
    ordered = {prefix: np.sort(np.concatenate(kept)) for prefix, kept in found.items()}
    return [float(ordered[prefix][rank]) for prefix, rank in zip(known, left, strict=True)]


def _keys(values: NDArray[np.float64]) -> NDArray[np.uint64]:
    """Whole numbers in the order of the values."""
    bits = (values + 0.0).view(np.uint64)  # no zero below zero
    return np.where(bits & _SIGN, ~bits, bits | _SIGN)
