"""What can be done to tell: wait, step the setpoint, or step the valve in manual; sizes within what the user allows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..record import FloatArray


@dataclass(frozen=True)
class Move:
    """A limit on a move: a share of the span, or in units of the loop."""

    size: float
    of_span: bool = True

    def share(self, span: tuple[float, float]) -> float:
        """The limit as a share of a span from low to high."""
        return self.size if self.of_span else self.size / abs(span[1] - span[0])


KINDS = ("wait", "setpoint_steps", "manual_test")  # the least trouble first
TENTH = Move(0.1)


@dataclass(frozen=True)
class Test:
    """kind: wait, setpoint_steps or manual_test. levels: of SP or OP one after the other, in moves [span], each held
    for hold [s]. A wait has one level of no move."""

    kind: str
    hold: float
    move: float = 0.0
    levels: tuple[float, ...] = (0.0,)

    @property
    def duration(self) -> float:
        """How long it takes [s]."""
        return self.hold * len(self.levels)

    def course(self, time: FloatArray) -> FloatArray:
        """The move [span] at times [s] from its start, (samples,); none before and after."""
        at = np.floor(time / self.hold).astype(np.int64)
        within = (at >= 0) & (at < len(self.levels))
        return np.where(within, self.move * np.array(self.levels)[at.clip(0, len(self.levels) - 1)], 0.0)
