"""Advice on a compensator as text for a terminal, as plain values, and as a page with the loop before and after."""

from __future__ import annotations

from typing import Any

from ..results.compensation import CompensationStudy
from ..results.plan import Course
from .console import screen
from .figures import EVIDENCE, GREEN, MEASUREMENT, OUTPUT, QUIET, Figure, across, axis, trace, written
from .json_report import SCHEMA_VERSION, fields_of, json_text
from .page import page
from .safe import shorten
from .words import percent

ADVICE = ("This is advice to a person. Nothing was written to the control system; whether and how to try it is a "
          "decision of the people who run the plant.")
COLUMNS = ("Gain [%]", "of d", "Mean error", "Peak error", "Valve travel", "OP travel", "Reversals", "Limit cycle")


def to_text(study: CompensationStudy, *, colour: bool = False) -> str:
    """Return what was assumed, the table of gains, and the recommendation."""
    return screen("compensate.txt", colour=colour, study=study, advice=ADVICE,
                  columns="|".join(f">{name}" for name in COLUMNS))


def compensation_page(study: CompensationStudy) -> str:
    """Return the page of one study."""
    return page("compensate.html", f"Backlash compensation: {shorten(study.loop, 80)}",
                subtitle="Simulated; nothing was written to the control system", columns=COLUMNS, gains=gains(study),
                trends=None if study.before is None else trends(study), study=study, advice=ADVICE)


def to_json(study: CompensationStudy) -> str:
    """Return the study as JSON text; normalised signals, seconds."""
    recommended = {"gain": study.recommended, "scheme": "error-sign (9)", "hysteresis": study.hysteresis}
    return json_text({
        "schema_version": SCHEMA_VERSION,
        **{name: getattr(study, name) for name in ("loop", "settings", "output_noise", "load", "reason", "rule_gain",
                                                   "refusals", "warnings")},
        "dead_band": {"d": study.d, "ci95": study.interval, "source": study.d_source},
        "process": fields_of(study.process, "profile"),
        "recommended": None if study.recommended is None else recommended,
        "trials": [
            {"gain": t.gain, "iae": t.iae, "peak": t.peak, "valve_travel_per_hour": t.travel,
             "output_travel_per_hour": t.output_travel, "reversals_per_hour": t.reversals, "limit_cycle": t.limit_cycle}
            for t in study.trials
        ],
        "advice": ADVICE,
    })


def trends(study: CompensationStudy) -> Figure:
    """Return measurement, output and valve position before and after."""
    assert study.before is not None

    def line(run: Course, values: tuple[float, ...], name: str, colour: str, **more: Any) -> Figure:
        return trace([round(t, 3) for t in run.time], [round(100.0 * v, 4) for v in values], name, colour,
                     hover="%{y:.2f}", width=1.4, **more)

    data = [line(study.before, study.before.setpoint, "setpoint", QUIET, dash="dot")]
    runs = [(study.before, "without", OUTPUT)]
    if study.after is not None and study.recommended is not None:
        runs.append((study.after, f"gain {percent(study.recommended)}", MEASUREMENT))
    for run, name, colour in runs:
        data += [line(run, run.measurement, f"PV, {name}", colour),
                 line(run, run.output, f"OP, {name}", colour, yaxis="y2"),
                 line(run, run.valve, f"valve, {name}", colour, yaxis="y3")]
    return {"data": data, "layout": {
        "height": 620, "hovermode": "x", "xaxis": axis("time [s]", anchor="y3"),
        "yaxis": axis("PV, deviation [%]", domain=[0.7, 1.0]), "yaxis2": axis("OP, change [%]", domain=[0.36, 0.64]),
        "yaxis3": axis("valve, change [%]", domain=[0.0, 0.3])}}


def gains(study: CompensationStudy) -> Figure:
    """Return mean error, peak and travel over the gain, relative to no compensator."""
    x, data = [100.0 * t.gain for t in study.trials], []
    shown = (("mean error", "iae", MEASUREMENT), ("peak error", "peak", QUIET), ("valve travel", "travel", EVIDENCE))
    for name, key, colour in shown:
        first = getattr(study.base, key)
        y = [getattr(t, key) / first if first > 0 else None for t in study.trials]
        data.append(trace(x, y, name, colour, mode="lines+markers", size=6, hover="%{y:.2f}"))
    marks = [(study.d, "dead band", "left", QUIET, "dot")]
    if study.recommended is not None:
        marks.append((study.recommended, "advice", "right", GREEN, "solid"))
    top = min(max(3.0, 1.1 * max((t.iae / study.base.iae for t in study.trials), default=1.0)), 6.0)
    return {"data": data, "layout": {
        "xaxis": axis("compensator gain [% of output span]"), "height": 380,
        "yaxis": axis("relative to no compensator", range=[0, top]),
        "shapes": [across("x", 100 * at, colour, width=2, dash=dash) for at, _, _, colour, dash in marks],
        "annotations": [written(text, 100 * at, 1.0, yref="paper", xanchor=side) for at, text, side, _, _ in marks]}}
