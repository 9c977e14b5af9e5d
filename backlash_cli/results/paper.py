"""The paper's numbers beside ours: one row per number, one figure per figure; all that a reporter sees of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from ..record import FloatArray


@dataclass(frozen=True)
class Published:
    """One number of the paper with the tolerance within which ours must agree.

    key: name of our number. figure: the drawing it belongs to. unit: "s", "%", "count" or "yes/no" (1 is yes).
    why: empty where we agree; else why we do not, and then `certified` is the number that we get instead (from the
    describing function, a closed form or an independent simulation), within `certified_tolerance`.
    """

    key: str
    figure: str
    quantity: str
    unit: str
    value: float
    tolerance: float
    why: str = ""
    certified: float | None = None
    certified_tolerance: float = 0.0


@dataclass(frozen=True)
class PaperRow:
    """One line of the table: the published number and ours."""

    published: Published
    ours: float

    @property
    def difference(self) -> float:
        """Ours minus the paper's."""
        return self.ours - self.published.value

    @property
    def agrees(self) -> bool:
        """True when ours lies within the row's tolerance of the paper's."""
        return bool(abs(self.difference) <= self.published.tolerance * (1.0 + 1e-9))


@dataclass(frozen=True, eq=False)
class Line:
    """A curve: x and y (points,), its name, dash: "solid", "dash" or "dot"; quiet lines are drawn in grey."""

    name: str
    x: FloatArray
    y: FloatArray
    dash: str = "solid"
    quiet: bool = False


@dataclass(frozen=True)
class Mark:
    """A short text at a point of a panel."""

    x: float
    y: float
    text: str


@dataclass(frozen=True)
class Panel:
    """One diagram; limits are the visible range of each axis, None: all."""

    lines: tuple[Line, ...]
    x_label: str
    y_label: str
    marks: tuple[Mark, ...] = ()
    x_limits: tuple[float, float] | None = None
    y_limits: tuple[float, float] | None = None
    equal_scales: bool = False


@dataclass(frozen=True)
class PaperFigure:
    """A figure of the paper drawn anew: panels below each other, and what to see in it."""

    key: str
    title: str
    panels: tuple[Panel, ...]
    text: str = ""


@dataclass(frozen=True)
class PaperReport:
    """All rows and figures. lists: key of a figure -> the single estimates, paper's and ours, as text."""

    rows: tuple[PaperRow, ...]
    figures: tuple[PaperFigure, ...]
    lists: Mapping[str, tuple[str, str]] = field(default_factory=dict)
