"""Order statistics of more values than memory should hold, found by going through them a few times."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from .scaling import ASKED, quantile

Stream = Callable[[], Iterator[NDArray[np.float64]]]
DIGITS = (20, 16, 16, 12)  # bits that are settled each time the values are gone through
FEW = 1 << 20  # values that may be looked at together
_SIGN = np.uint64(1 << 63)


class StreamValues:
    """Finite values of a signal, given anew each time they are asked for; others are passed over."""

    def __init__(self, stream: Stream, low: float = -np.inf, high: float = np.inf) -> None:
        self._stream, self._low, self._high = stream, low, high
        self._known: dict[float, float] = {}

    def __iter__(self) -> Iterator[NDArray[np.float64]]:
        for values in self._stream():
            keep = np.isfinite(values) & (values >= self._low) & (values <= self._high)
            yield values if keep.all() else values[keep]

    @property
    def ends(self) -> tuple[float, float] | None:
        low, high, count, _ = self._look
        return (low, high) if count else None

    @cached_property
    def _look(self) -> tuple[float, float, int, NDArray[np.int64]]:
        """(least, greatest, number, how many of each first digit) of the values."""
        low, high, count = np.inf, -np.inf, 0
        digits = np.zeros(1 << DIGITS[0], np.int64)
        for values in self:
            if len(values):
                low, high = min(low, float(values.min())), max(high, float(values.max()))
                count += len(values)
                digits += _counted(_keys(values), 64 - DIGITS[0], DIGITS[0])
        return low, high, count, digits

    def quantiles(self, shares: list[float]) -> list[float]:
        if not set(shares) <= self._known.keys():
            wanted = sorted({*shares, *ASKED})
            *_, count, digits = self._look
            ranks = sorted({min(int(share * (count - 1)) + k, count - 1) for share in wanted for k in (0, 1)})
            at = dict(zip(ranks, order_statistics(self.__iter__, ranks, digits), strict=True))
            self._known.update((share, quantile(at.__getitem__, count, share)) for share in wanted)
        return [self._known[share] for share in shares]

    def within(self, low: float, high: float) -> StreamValues:
        return StreamValues(self._stream, max(low, self._low), min(high, self._high))


def order_statistics(stream: Stream, ranks: Sequence[int], first: NDArray[np.int64]) -> list[float]:
    """Return the values of these ranks, counted from 0, exactly. first: how many values have each first digit.

    The bits of a number are settled from the highest on, a digit each time the values are gone through.
    """
    known = [0] * len(ranks)  # bits settled so far, by rank
    left = list(ranks)  # rank among the values that share them
    shift = 64
    for digit in DIGITS:
        shift -= digit
        counts = {0: first} if not any(known) and shift == 64 - digit else _counts(stream, set(known), shift, digit)
        alike = {}
        for place, prefix in enumerate(known):
            below = np.cumsum(counts[prefix])
            chosen = int(np.searchsorted(below, left[place], side="right"))
            left[place] -= int(below[chosen - 1]) if chosen else 0
            known[place] = (prefix << digit) | chosen
            alike[known[place]] = int(counts[prefix][chosen])
        if shift and sum(alike.values()) <= FEW:
            return _among(stream, known, left, shift)
    bits = np.array(known, np.uint64)
    return np.where(bits & _SIGN, bits ^ _SIGN, ~bits).view(np.float64).tolist()


def _counts(stream: Stream, prefixes: set[int], shift: int, digit: int) -> dict[int, NDArray[np.int64]]:
    """How many values that begin with certain bits have each of the next digits."""
    found = {prefix: np.zeros(1 << digit, np.int64) for prefix in prefixes}
    for values in stream():
        keys = _keys(values)
        begin = keys >> np.uint64(shift + digit)
        for prefix, count in found.items():
            count += _counted(keys[begin == np.uint64(prefix)], shift, digit)
    return found


def _counted(keys: NDArray[np.uint64], shift: int, digit: int) -> NDArray[np.int64]:
    digits = (keys >> np.uint64(shift)) & np.uint64((1 << digit) - 1)
    return np.bincount(digits.astype(np.int64), minlength=1 << digit)


def _among(stream: Stream, known: Sequence[int], left: Sequence[int], shift: int) -> list[float]:
    """The values of these ranks among those that begin with the bits known."""
    found: dict[int, list[NDArray[np.float64]]] = {prefix: [] for prefix in known}
    for values in stream():
        begin = _keys(values) >> np.uint64(shift)
        for prefix, kept in found.items():
            kept.append(values[begin == np.uint64(prefix)])
    ordered = {prefix: np.sort(np.concatenate(kept)) for prefix, kept in found.items()}
    return [float(ordered[prefix][rank]) for prefix, rank in zip(known, left, strict=True)]


def _keys(values: NDArray[np.float64]) -> NDArray[np.uint64]:
    """Whole numbers in the order of the values."""
    bits = (values + 0.0).view(np.uint64)  # no zero below zero
    return np.where(bits & _SIGN, ~bits, bits | _SIGN)
