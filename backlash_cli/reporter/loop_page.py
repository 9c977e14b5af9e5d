"""Everything about one loop on a page: why the verdict, the evidence drawn on the record, numbers and settings."""

from __future__ import annotations

from collections.abc import Sequence

from ..record import Note, Record
from ..results import UNDECIDED, LoopReport
from . import figures
from .page import Cell, Section, Table
from .safe import shorten
from .words import compensator_words, duration, interval, moment, percent, size


def loop_sections(r: LoopReport, record: Record | None, points: int = figures.POINTS) -> list[Section]:
    """Return everything about one loop: reasons, figures (when its record is given), numbers, settings, warnings.

    points: of each line over time.
    """
    evidence = [] if record is None or not len(record) else _evidence(r, record, points)
    said = [n.message for n in r.reasons] or ["No reason was recorded."]
    if r.verdict in UNDECIDED:
        said.append("What would decide it: backlash plan.")
    first = evidence[0] if evidence else Section("")
    sections = [Section("Why this verdict", text=said, figure=first.figure, note=first.note)]
    if r.compensator is not None:
        sections.append(Section("Advice", text=compensator_words(r.compensator)))
    sections += evidence[1:]
    sections += [Section("Numbers", table=_numbers(r)), Section("Controller settings", table=_settings(r))]
    if r.warnings:
        sections.append(Section("Warnings", table=note_table(r.warnings)))
    return sections


def _evidence(r: LoopReport, record: Record, points: int) -> list[Section]:
    """What can be seen with bare eyes first: OP that moves while PV stays."""
    window = figures.close_look(record, r)
    look = "The record around an ordinary half period. " if window.stop - window.start < len(record) else ""
    look += ("Shaded: OP crosses the gap and the stem stands still; look whether PV stays as well, and answers when "
             "the stem moves again." if size(r) is not None and record.output is not None else
             "Look for an output that ramps while the measurement stays.")
    sections = [
        Section("Close look", figure=figures.trend(record, r, window, points, room=0.06), note=look),
        Section("Trend", figure=figures.trend(record, r, points=points),
                note="Whole record. The thick line marks the half periods that entered the estimate. Drag to zoom, "
                     "double-click to return."),
    ]
    if record.output is not None:
        sections.append(Section("PV against OP", figure=figures.plane(record, window, r, points),
                                note="Without dead band PV answers every turn of OP. With dead band OP turns and moves "
                                     "on while PV waits: the path gets flat sides."))
    if r.estimates:
        sections.append(Section("Estimates", figure=figures.estimates(r),
                                note="One point per half period. Line and band: the size and its 95 % interval."))
    if r.confirmation is not None and r.confirmation.profile:
        sections.append(Section("Confirmation", figure=figures.profile(r),
                                note="How well PV follows OP through a dead band of each size; a peak speaks for a "
                                     "dead band of that size. Band: its 95 % interval."))
    return sections


def _numbers(r: LoopReport) -> Table:
    rows: list[list[object]] = [
        ["Recording", f"{moment(r.start)} to {moment(r.end)}"],
        ["Samples", r.samples if r.interval_s is None else f"{r.samples}, every {duration(r.interval_s)}"],
        ["Half periods", f"{r.half_periods}, of which {r.long_half_periods} long enough"],
        ["Detections", f"{r.detections} ({percent(r.detection_rate, 0)} of the half periods, "
                       f"{r.detections_per_hour:.3g} per hour)"],
        ["Not used", ", ".join(f"{n} {code}" for code, n in r.rejected.items()) or "none"],
    ]
    if (c := r.cluster) is not None:
        rows += [
            ["Cluster", f"{percent(c.d)} ({interval(c.ci95)}), {c.n} estimates, {percent(c.share, 0)} of all"],
            ["Spread", f"{percent(c.spread, 0)} of the size"],
            ["Limit of detection", percent(c.limit_of_detection)],
        ]
    if (f := r.confirmation) is not None:
        rows += [
            ["Confirmation", f"{percent(f.d)} ({interval(f.ci95)})"],
            ["Prediction error removed", percent(f.error_reduction, 0)],
            ["Evidence (BIC difference)", f"{f.delta_bic:.1f}"],
        ]
    return Table(["What", "Value"], rows, sortable=False)


def _settings(r: LoopReport) -> Table:
    s = r.settings
    names = [
        ("K", "controller gain K", s.K), ("Ti", "integral time Ti [s]", s.Ti), ("Td", "derivative time Td [s]", s.Td),
        ("Tf", "measurement filter Tf [s]", s.filter_time), ("Kp", "process gain Kp", s.Kp),
        ("theta", "dead time theta [s]", s.theta), ("pv_range", "PV span", s.pv_range),
        ("op_range", "OP span", s.op_range),
    ]
    rows: list[list[object]] = []
    for key, words, value in names:
        shown = f"{value[0]:g} to {value[1]:g}" if isinstance(value, tuple) else value
        rows.append([words, shown if isinstance(shown, str) else Cell(shown), s.source.get(key, "")])
    return Table(["Setting", "Value", "From"], rows, sortable=False)


def note_table(notes: Sequence[Note]) -> Table:
    """Reasons or warnings as a table."""
    return Table(["Code", "What"], [[n.code, shorten(n.message, 2000)] for n in notes])
