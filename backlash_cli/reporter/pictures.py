"""One picture per loop for paper and mail: the evidence behind the verdict, drawn on the trend (PNG or SVG).

    draw_loop(record, report, folder) -> Path

Top: setpoint, measurement and output with the half periods that carry the verdict and their estimates. Bottom: a close
look with the stretches where the stem stands still, PV against OP with the dead band, and the evidence for each size.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from ..record import Record
from ..results import LoopReport
from . import figures
from .safe import file_name
from .still import still, write_still
from .words import VERDICTS, interval, percent, size

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SIZE = (13.0, 8.8)  # inches
DPI = 110
POINTS = 2400  # per line: what a picture of this width can show


def draw_loop(
    record: Record, report: LoopReport, folder: Path, *, name: str | None = None, suffix: str = ".png"
) -> Path:
    """Draw the evidence of one loop into `folder` and return the file's path.

    name: file name without suffix, made safe from the loop's name when not given. suffix: ".png" or ".svg". The folder
    must exist. Raises BacklashError when it cannot be written.
    """
    path = Path(folder) / f"{file_name(report.loop) if name is None else name}{suffix}"
    write_still(path, loop_figure(record, report), DPI)
    return path


def loop_figure(record: Record, report: LoopReport) -> Figure:
    """Return the picture as a matplotlib Figure that belongs to no window."""
    record = figures.known_part(record)
    window = figures.close_look(record, report)
    words = f"{report.loop}: {VERDICTS[report.verdict]}"
    if (d := size(report)) is not None and report.cluster is not None:
        words += f", dead band {percent(d)} of the output span ({interval(report.cluster.ci95)})"
    below = [("close look", figures.trend(record, report, window, POINTS, room=0.06))]
    if record.output is not None:
        below.append(("PV against OP (red: close look)", figures.plane(record, window, report, points=4000)))
    if report.confirmation is not None and len(report.confirmation.profile) > 2:
        below.append(("evidence for each size of dead band", figures.profile(report)))
    else:
        below.append(("estimates from the half periods", figures.estimates(report)))
    return still(words, [[("", figures.trend(record, report, points=POINTS, room=0.016))], below], (1.2, 1.0), SIZE)
