"""Simulations as figures in the style of the paper: setpoint and measurement above, controller output below."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...record import Record
from ...results import Estimate
from ...results.paper import Line, Mark, Panel, PaperFigure
from ..loop import Trace

POINTS = 1500


def trend(key: str, title: str, run: Trace, text: str = "", marks: Sequence[Mark] = ()) -> PaperFigure:
    """Return the two diagrams of a simulation: y and setpoint, u and valve position."""
    thin = slice(None, None, max(1, len(run.setpoint) // POINTS))
    t = run.time[thin]
    above = Panel((Line("setpoint", t, run.setpoint[thin], "dot", quiet=True), Line("y", t, run.measurement[thin])),
                  "", "y", tuple(marks))
    below = Panel((Line("valve", t, run.valve[thin], "dot", quiet=True), Line("u", t, run.output[thin])),
                  "time [s]", "u")
    return PaperFigure(key, title, (above, below), text)


def recording(key: str, title: str, record: Record, found: Sequence[Estimate], text: str = "") -> PaperFigure:
    """Return a record with its estimates [%] written where they were made; refused ones in brackets."""
    assert record.output is not None
    thin = slice(None, None, max(1, len(record) // POINTS))
    t = record.time[thin] - record.start
    top = float(np.max(record.measurement))
    marks = tuple(
        Mark(e.end - record.start, top, f"{100 * e.d:.1f}" if e.accepted else f"({100 * e.d:.1f})") for e in found
    )
    above = Panel((Line("setpoint", t, record.setpoint[thin], "dot", quiet=True),
                   Line("y", t, record.measurement[thin])), "", "y", marks)
    below = Panel((Line("u", t, record.output[thin]),), "time [s]", "u")
    return PaperFigure(key, title, (above, below), text)


def listed(found: Sequence[Estimate]) -> str:
    """Return accepted estimates in % as the paper prints them."""
    return " ".join(f"{100 * e.d:.1f}" for e in found if e.accepted)
