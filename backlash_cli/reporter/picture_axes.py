"""What every axis of the pictures shares: lines over time, shaded half periods, plain frames."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..record import FloatArray, Record
from ..results import Estimate, LoopReport
from .figures import EVIDENCE, thin

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FALLING = "#5b7f95"


def used_in(report: LoopReport, record: Record) -> list[Estimate]:
    """The accepted half periods that lie within the record shown."""
    if not len(record):
        return []
    first, last = record.time[[0, -1]]
    return [e for e in report.estimates if e.accepted and e.end >= first and e.start <= last]


def shade(axes: Axes, used: Sequence[Estimate]) -> None:
    for estimate in used:
        colour = EVIDENCE if estimate.direction > 0 else FALLING
        axes.axvspan(date(estimate.start), date(estimate.end), color=colour, alpha=0.16, linewidth=0)


def write_estimates(axes: Axes, used: Sequence[Estimate], *, room: float) -> None:
    """Write estimates where they were made; one closer than `room` (share of the width) to the last is left out."""
    first, last = axes.get_xlim()
    written = 0.0
    for estimate in used:
        middle = date(0.5 * (estimate.start + estimate.end))
        place = (middle - first) / (last - first)
        if written + room <= place <= 0.98:
            written = place
            axes.text(
                middle, 0.97, f"{100 * estimate.d:.1f} %", transform=axes.get_xaxis_transform(), ha="center", va="top",
                rotation=90, fontsize=8, color="black",
            )


def draw_line(
    axes: Axes, record: Record, values: FloatArray, span: tuple[float, float], colour: str, label: str, **style: Any
) -> None:
    """A line thinned to its smallest and largest values, broken at gaps."""
    chosen, gaps = thin(record.index, values)
    x = np.insert(date(record.time[chosen]), gaps, np.nan)
    y = np.insert(units(values[chosen], span), gaps, np.nan)
    axes.plot(x, y, color=colour, label=label, **style)


def units(values: FloatArray, span: tuple[float, float]) -> FloatArray:
    """Engineering units; a span of 0..1 is shown in per cent."""
    low, high = span if span != (0.0, 1.0) else (0.0, 100.0)
    return low + (high - low) * values


def date(epoch: Any) -> Any:
    """Matplotlib's days since 1970 from UTC epoch seconds."""
    return np.asarray(epoch) / 86400.0


def legend_above(axes: Axes, *, shaded: bool) -> None:
    from matplotlib.patches import Patch

    handles, labels = axes.get_legend_handles_labels()
    if shaded:
        handles += [Patch(color=EVIDENCE, alpha=0.3), Patch(color=FALLING, alpha=0.3)]
        labels += ["used, SP above PV", "used, SP below PV"]
    axes.legend(handles, labels, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=4, fontsize=8, frameon=False)


def time_axis(axes: Axes, record: Record) -> None:
    from matplotlib.dates import AutoDateLocator, ConciseDateFormatter

    locator = AutoDateLocator(maxticks=10)
    axes.xaxis.set_major_locator(locator)
    axes.xaxis.set_major_formatter(ConciseDateFormatter(locator))
    if len(record):
        room = max(0.0, 60.0 - (record.time[-1] - record.time[0])) / 2.0  # dates need a minute at least
        axes.set_xlim(date(record.time[0] - room), date(record.time[-1] + room))
    plain(axes)


def plain(axes: Axes) -> None:
    axes.grid(True, color="#e3e7ea", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=8)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
