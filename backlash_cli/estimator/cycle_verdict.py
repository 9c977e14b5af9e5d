"""What an oscillation adds to a verdict: what it looks like, and a verdict where the other tests could not be made.

The mean cycle of PV behind OP needs neither setpoint nor settings, and few samples per Ti. So a valve that makes its
loop cycle is suspected also where K and Ti are not to be had, or the record is too coarse or too short against Ti.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..record import Note, Record
from ..results import NOTHING_SAID, LoopReport, Verdict
from .assumed_setpoint import at_mean
from .diagnosis import diagnose

NOT_TESTED = {"missing_settings", "no_setpoint", "sampling_too_coarse", "short_record"}
# kinds of oscillation that put the valve under suspicion, with the confidence that it is right to do so: simulated
# cycles called stiction come from a valve in all of 165 loops; of the other only one recording is known
VALVE = {"stiction": 0.9, "tight_nonlinear": 0.5}


def with_oscillation(report: LoopReport, record: Record) -> LoopReport:
    """Return the report with what an oscillation of the record looks like, and the verdict that follows from it."""
    codes = {reason.code for reason in report.reasons}
    seen, untested = "oscillation" in codes, report.verdict in NOTHING_SAID and bool(codes & NOT_TESTED)
    if not (seen or untested):
        return report
    blind = not np.isfinite(record.setpoint).any()
    whole = at_mean(record) if blind else record
    if whole is None:
        return report
    found = diagnose(whole)
    if untested and found.kind == "none":
        return report
    note = found.note
    if blind:  # a setpoint that switches to and fro makes cycles that cannot be told from a sticking valve's
        note = replace(note, message=f"{note.message}; or the setpoint, which was not recorded, swings")
    if report.verdict not in (Verdict.OSCILLATING, *NOTHING_SAID):
        return replace(report, reasons=(*report.reasons, note))
    period = found.period or 0.0
    repeats = () if seen else (
        Note("oscillation", f"PV oscillates with a period of {period:.3g} s", {"period_s": period}),)
    if found.kind in VALVE and not blind:
        return replace(report, verdict=Verdict.SUSPECTED, reasons=(note, *repeats, *report.reasons),
                       confidence=VALVE[found.kind])
    if untested:
        return replace(report, verdict=Verdict.OSCILLATING, reasons=(*repeats, note, *report.reasons), confidence=0.5)
    return replace(report, reasons=(*report.reasons, note))
