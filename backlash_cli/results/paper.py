"""The paper's numbers beside ours: one row per number, one figure per figure; all that a reporter sees of them."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ..record import FloatArray


@dataclass(frozen=True)
class PaperRow:
    """One number of the paper, with the tolerance within which ours must agree, and ours."""

    key: str  # name of our number
    figure: str  # the drawing it belongs to
    quantity: str
    unit: str  # "s", "%", "count" or "yes/no" (1 is yes)
    value: float
    tolerance: float
    # where we do not agree, why; and the number that we get instead (from the describing function, a closed form or an
    # independent simulation), within its own tolerance
    why: str = ""
    certified: float | None = None
    certified_tolerance: float = 0.0
    ours: float = math.nan

    @property
    def difference(self) -> float:
        """Ours minus the paper's."""
        return self.ours - self.value

    @property
    def agrees(self) -> bool:
        """True when ours lies within the row's tolerance of the paper's."""
        return bool(abs(self.difference) <= self.tolerance * (1.0 + 1e-9))


@dataclass(frozen=True, eq=False)
class Line:
    """A curve: x and y (points,)."""

    name: str
    x: FloatArray
    y: FloatArray
    dash: str = "solid"  # "dash" or "dot"
    quiet: bool = False  # drawn in grey


@dataclass(frozen=True)
class Panel:
    """One diagram."""

    lines: tuple[Line, ...]
    x_label: str
    y_label: str
    marks: tuple[tuple[float, float, str], ...] = ()  # x, y and a short text there
    square: tuple[float, float] | None = None  # visible range of both axes, which then have one scale; None: all


@dataclass(frozen=True)
class PaperFigure:
    """A figure of the paper drawn anew: panels below each other, and what to see in it."""

    key: str
    title: str
    panels: tuple[Panel, ...]
    text: str = ""
