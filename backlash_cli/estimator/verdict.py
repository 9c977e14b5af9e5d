"""From estimates to an answer, by the paper's idea: detections are frequent and the estimates are close."""

from __future__ import annotations

from ..record import Note
from ..results import Cluster, Verdict
from .oscillation import Oscillation

ENOUGH = 3


def decide(cluster: Cluster | None, detections: int, long_half_periods: int,
           oscillation: Oscillation) -> tuple[Verdict, tuple[Note, ...], float]:
    """Return verdict, reasons and confidence from the half periods alone."""
    if oscillation.present and oscillation.share > 0.5:
        return Verdict.OSCILLATING, (Note("oscillation", f"the control error oscillates with a period of "
                                          f"{oscillation.period:.3g} s during {oscillation.share:.0%} of the record"),), 0.8
    if long_half_periods == 0:
        return Verdict.NO_BACKLASH, (Note("no_long_half_periods", "the control error never stays on one side for "
                                          "5 Ti or longer"),), 0.5
    if cluster and cluster.n >= ENOUGH and cluster.spread < 0.5 and cluster.share >= 0.5:
        return Verdict.BACKLASH, (Note("estimates_agree", f"{cluster.n} of {detections} estimates gather at "
                                       f"{100 * cluster.d:.2g} % of span"),), 0.6
    return Verdict.CANNOT_TELL, (Note("estimates_scatter", f"{detections} detections, not enough of them alike"),), 0.3
