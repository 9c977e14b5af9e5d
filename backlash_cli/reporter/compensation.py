"""Advice on a compensator as text for a terminal, as plain values, and as a page with the loop before and after."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..record import FloatArray
from ..results.compensation import CompensationStudy, Glimpse, ProcessModel, Trial
from .console import Screen
from .figures import EVIDENCE, MEASUREMENT, OUTPUT, QUIET
from .json_report import fields_of, strict
from .loop_page import note_table
from .page import Cell, Section, Table, page
from .safe import shorten, terminal

ADVICE = ("This is advice to a person. Nothing was written to the control system; whether and how to try it is a "
          "decision of the people who run the plant.")
COLUMNS = ("Gain [%]", "of d", "Mean error", "Peak error", "Valve travel", "OP travel", "Reversals", "Limit cycle")
RECOMMENDED = "#2a9d5c"


def to_text(study: CompensationStudy, *, colour: bool = False) -> str:
    """Return what was assumed, the table of gains, and the recommendation."""
    screen = Screen(colour=colour)
    screen.say(f"{terminal(study.loop, 60)}: {headline(study)}")
    screen.say()
    for line in assumptions(study):
        screen.say(terminal(line))
    screen.say()
    screen.table([f">{name}" for name in COLUMNS], [cells(study, trial) for trial in study.trials], styles=[
        ["bold green" if trial.gain == study.recommended else ""] * len(COLUMNS) for trial in study.trials])
    screen.say("\nErrors, travel and reversals relative to the loop without compensator (first line).")
    for word, notes in (("against", study.refusals), ("warning", study.warnings)):
        for note in notes:
            screen.say(f"{word}: {terminal(note.message)} ({note.code})")
    screen.say(f"\n{ADVICE}")
    return screen.text()


def headline(study: CompensationStudy) -> str:
    """Return the recommendation in a sentence."""
    if study.recommended is None:
        return f"no compensator is recommended: {study.reason}."
    trial = study.trial(study.recommended)
    fall = 100.0 * (1.0 - trial.iae / study.base.iae)
    more = percent(trial.travel, study.base.travel)
    travel = "leave the valve's travel as it is" if more == "0 %" else f"change the valve's travel by {more}"
    return (f"a compensator gain of {100 * study.recommended:.2f} % of the output span, sign of the control error "
            f"(eq. 9), would lower the mean error by {fall:.0f} % and {travel}. "
            f"Why this gain: {study.reason}.")


def assumptions(study: CompensationStudy) -> list[str]:
    """Return what the simulation started from, line by line."""
    low, high = (100.0 * end for end in study.interval)
    s = study.settings
    size = f"{100 * study.d:.2f} %" + (f" ({low:.2f} to {high:.2f} %)" if high > low else "")
    return [
        f"Dead band  {size} of the output span, {'from the scan' if study.d_source == 'scan' else 'as given'}",
        f"Controller K {s['K']:.4g}, Ti {s['Ti']:.4g} s, Td {s['Td']:.4g} s, filter {s['Tf']:.3g} s",
        f"Process    {process_words(study.process)}",
        f"Noise      {100 * study.output_noise:.2g} % on the output ({100 * study.output_noise / study.d:.0f} % of the "
        f"dead band); loads up and down, about {100 * study.load:.2g} %",
        f"Compensator: sign changes when the error is {100 * study.hysteresis:.2g} % beyond zero",
    ]


def process_words(model: ProcessModel) -> str:
    """Return the process in a line."""
    lags = " and ".join(f"{lag:.3g} s" for lag in model.lags) or "none"
    kind = "integrating, " if model.integrating else ""
    return f"{kind}gain {model.gain:.3g}, lag {lags}, dead time {model.dead_time:.3g} s ({model.source})"


def cells(study: CompensationStudy, trial: Trial) -> list[str]:
    """Return the row of one gain; the first row in its own units, the others relative to it."""
    base = study.base
    mark = "<-" if trial.gain == study.recommended else ""
    if trial.gain == 0.0:
        return ["none", "", f"{100 * base.iae:.3f} %", f"{100 * base.peak:.2f} %", f"{100 * base.travel:.3g} %/h",
                f"{100 * base.output_travel:.3g} %/h", f"{base.reversals:.3g} /h", "yes" if base.limit_cycle else "no"]
    return [f"{100 * trial.gain:.2f} {mark}".strip(), f"{trial.gain / study.d:.2f}", percent(trial.iae, base.iae),
            percent(trial.peak, base.peak), percent(trial.travel, base.travel),
            percent(trial.output_travel, base.output_travel), percent(trial.reversals, base.reversals),
            "yes" if trial.limit_cycle else "no"]


def percent(value: float, base: float) -> str:
    """Return the change from the base.

    >>> percent(0.8, 1.0), percent(3.0, 1.0), percent(0.999, 1.0)
    ('-20 %', '+200 %', '0 %')
    """
    if not base > 0.0:
        return "–"
    change = round(100.0 * (value / base - 1.0))
    return f"{change:+d} %" if change else "0 %"


def to_document(study: CompensationStudy) -> dict[str, Any]:
    """Return the study as plain values for JSON; normalised signals, seconds."""
    found: dict[str, Any] = strict({
        "schema_version": 1, "loop": study.loop, "settings": study.settings,
        "dead_band": {"d": study.d, "ci95": study.interval, "source": study.d_source},
        "process": fields_of(study.process, "profile"), "output_noise": study.output_noise, "load": study.load,
        "recommended": None if study.recommended is None else {
            "gain": study.recommended, "scheme": "error-sign (9)", "hysteresis": study.hysteresis},
        "reason": study.reason, "rule_gain": study.rule_gain,
        "refusals": [{"code": n.code, "message": n.message} for n in study.refusals],
        "warnings": [{"code": n.code, "message": n.message} for n in study.warnings],
        "trials": [
            {"gain": t.gain, "iae": t.iae, "peak": t.peak, "valve_travel_per_hour": t.travel,
             "output_travel_per_hour": t.output_travel, "reversals_per_hour": t.reversals, "limit_cycle": t.limit_cycle}
            for t in study.trials
        ],
        "advice": ADVICE,
    })
    return found


def compensation_page(study: CompensationStudy) -> str:
    """Return the page of one study."""
    name = shorten(study.loop, 80)
    sentence = headline(study)
    sections = [
        Section("Advice", text=[sentence[0].upper() + sentence[1:], ADVICE]),
        Section("What was simulated", text=assumptions(study),
                note="Load steps up and down at the process input, noise as in the record, the same for every gain."),
    ]
    if study.before is not None:
        sections.append(Section(
            "Before and after" if study.after is not None else "The loop as it is", figure=trends(study),
            text=["Two load steps. The valve follows the output only after it has crossed the dead band; the "
                  "compensator makes the output jump through the band when the error changes its sign."],
        ))
    sections.append(Section("Every gain", figure=gains(study), table=table(study), text=[
        "A larger gain lowers the error until it comes near the dead band; then the valve's travel grows. Errors and "
        "travel are relative to the loop without compensator."]))
    notes = [*study.refusals, *study.warnings]
    if notes:
        sections.append(Section("What speaks against it", table=note_table(notes)))
    return page(f"Backlash compensation: {name}", sections,
                subtitle="Simulated; nothing was written to the control system")


def table(study: CompensationStudy) -> Table:
    """Return the table of gains."""
    rows = []
    for trial in study.trials:
        mark = "good" if trial.gain == study.recommended else "bad" if trial.limit_cycle else ""
        texts = [text.removesuffix(" <-") for text in cells(study, trial)]
        rows.append([Cell(trial.gain, text=texts[0], mark=mark), *texts[1:]])
    return Table(COLUMNS, rows)


def trends(study: CompensationStudy) -> dict[str, Any]:
    """Return measurement, output and valve position before and after, as a plotly figure."""
    assert study.before is not None
    data = [_line(study.before, "setpoint", "setpoint", "", QUIET, "dot")]
    runs = [(study.before, "without", OUTPUT)]
    if study.after is not None:
        runs.append((study.after, f"gain {100 * study.after.gain:.2f} %", MEASUREMENT))
    for run, name, colour in runs:
        data.append(_line(run, "measurement", f"PV, {name}", "", colour))
        data.append(_line(run, "output", f"OP, {name}", "2", colour))
        data.append(_line(run, "valve", f"valve, {name}", "3", colour))
    return {"data": data, "layout": {
        "height": 620, "hovermode": "x", "xaxis": {"title": {"text": "time [s]"}, "anchor": "y3"},
        "yaxis": {"title": {"text": "PV, deviation [%]"}, "domain": [0.7, 1.0]},
        "yaxis2": {"title": {"text": "OP, change [%]"}, "domain": [0.36, 0.64]},
        "yaxis3": {"title": {"text": "valve, change [%]"}, "domain": [0.0, 0.3]},
    }}


def gains(study: CompensationStudy) -> dict[str, Any]:
    """Return mean error, peak and travel over the gain, relative to no compensator, as a plotly figure."""
    base, x = study.base, [100.0 * t.gain for t in study.trials]
    data: list[dict[str, Any]] = []
    shown = (("mean error", "iae", MEASUREMENT), ("peak error", "peak", QUIET), ("valve travel", "travel", EVIDENCE))
    for name, key, colour in shown:
        first = getattr(base, key)
        y = [getattr(t, key) / first if first > 0 else None for t in study.trials]
        data.append({"type": "scatter", "mode": "lines+markers", "name": name, "x": x, "y": y,
                     "line": {"color": colour}, "hovertemplate": "%{y:.2f}"})
    line: dict[str, Any] = {"type": "line", "yref": "paper", "y0": 0, "y1": 1}
    shapes = [line | {"x0": 100 * study.d, "x1": 100 * study.d, "line": {"color": QUIET, "dash": "dot"}}]
    word: dict[str, Any] = {"y": 1.0, "yref": "paper", "showarrow": False}
    texts = [word | {"x": 100 * study.d, "text": "dead band", "xanchor": "left"}]
    if study.recommended is not None:
        at = 100 * study.recommended
        shapes.append(line | {"x0": at, "x1": at, "line": {"color": RECOMMENDED}})
        texts.append(word | {"x": at, "text": "advice", "xanchor": "right"})
    top = min(max(3.0, 1.1 * max((t.iae / base.iae for t in study.trials), default=1.0)), 6.0)
    return {"data": data, "layout": {
        "xaxis": {"title": {"text": "compensator gain [% of output span]"}}, "shapes": shapes, "annotations": texts,
        "yaxis": {"title": {"text": "relative to no compensator"}, "range": [0, top]}, "height": 380,
    }}


def _line(run: Glimpse, key: str, name: str, axis: str, colour: str, dash: str = "solid") -> dict[str, Any]:
    values: FloatArray = getattr(run, key)
    return {"type": "scatter", "mode": "lines", "name": name, "x": np.round(run.time, 3).tolist(),
            "y": np.round(100.0 * values, 4).tolist(), "yaxis": f"y{axis}", "hovertemplate": "%{y:.2f}",
            "line": {"color": colour, "width": 1.4, "dash": dash}}
