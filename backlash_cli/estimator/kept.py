"""Which stretches of a long record are kept for the dead-band test, while it comes in."""

from __future__ import annotations

import heapq
from dataclasses import dataclass

from ..record import FloatArray, IntArray
from .block_kernel import STRETCH

WHOLE = 0.8  # share of its rows that a stretch in a row with others needs


@dataclass(eq=False, slots=True)
class Stretch:
    """Rows of up to STRETCH blocks, how far OP travels in them, and the shelf they lie on; or the rows themselves,
    block numbers and means, where few of them would fill a shelf."""

    number: int
    travel: float
    rows: int
    shelf: int
    own: tuple[IntArray, FloatArray] | None = None

    @property
    def whole(self) -> bool:
        """Whether it has few holes, so that the next one goes on where it ends."""
        return self.rows >= WHOLE * STRETCH


class Kept:
    """Of all stretches those in a row, of at most `most` rows together, in which OP travels most; and the ones in which
    it travels most wherever they are, for records that have no so many rows without a hole."""

    def __init__(self, most: int) -> None:
        self.most = most
        self.count = 0
        self.last: list[Stretch] = []  # in a row; they may become part of a better choice
        self.best: list[Stretch] = []
        self.lively: list[tuple[float, int, Stretch]] = []  # the calmest first, of equal ones the latest
        self._in_a_row = self._in_lively = 0  # rows
        self._most_travel = 0.0

    @property
    def stored(self) -> int:
        """Number of rows in memory."""
        return sum(s.rows for s in {*self.last, *self.best, *(s for _, _, s in self.lively)})

    def add(self, s: Stretch) -> list[Stretch]:
        """Take in the next stretch; return those that are not needed any more."""
        dropped: list[Stretch] = []
        self.count += s.rows
        if self.last and not (self.last[-1].whole and self.last[-1].number + 1 == s.number):
            dropped, self.last, self._in_a_row = self.last, [], 0
        self.last.append(s)
        self._in_a_row += s.rows
        while self._in_a_row > self.most:
            dropped.append(self.last.pop(0))
            self._in_a_row -= dropped[-1].rows
        if self._in_a_row > self.most - STRETCH:
            travel = sum([x.travel for x in self.last])
            if travel > self._most_travel:
                dropped += self.best
                self.best, self._most_travel = self.last.copy(), travel
        heapq.heappush(self.lively, (s.travel, -s.number, s))
        self._in_lively += s.rows
        while self._in_lively - self.lively[0][2].rows >= self.most:
            dropped.append(self._without_calmest())
        return [x for x in dict.fromkeys(dropped) if not self._has(x)]

    def chosen(self, *also: Stretch) -> list[Stretch]:
        """Return the stretches that are to be used, in the order of time, if those in `also` are the last ones."""
        whole = Kept(self.most)
        whole.last, whole.best, whole.lively = self.last.copy(), self.best, self.lively.copy()
        whole._in_a_row, whole._in_lively, whole._most_travel = self._in_a_row, self._in_lively, self._most_travel
        for s in also:
            whole.add(s)
        if whole.best:
            return whole.best
        while whole._in_lively > self.most:
            whole._without_calmest()
        return sorted((s for _, _, s in whole.lively), key=lambda s: s.number)

    def _without_calmest(self) -> Stretch:
        calmest = heapq.heappop(self.lively)[2]
        self._in_lively -= calmest.rows
        return calmest

    def _has(self, s: Stretch) -> bool:
        return s in self.last or s in self.best or (s.travel, -s.number, s) in self.lively
