"""Advice on a compensator as text for a terminal and as JSON."""

from __future__ import annotations

import io
from typing import Any

from rich.console import Console
from rich.table import Table

from ..results.compensation import CompensationStudy, ProcessModel, Trial
from .safe import terminal

WIDTH = 100
ADVICE = ("This is advice to a person. Nothing was written to the control system; whether and how to try it is a "
          "decision of the people who run the plant.")
COLUMNS = ("Gain [%]", "of d", "Mean error", "Peak error", "Valve travel", "OP travel", "Reversals", "Limit cycle")


def to_text(study: CompensationStudy, *, colour: bool = False) -> str:
    """Return what was assumed, the table of gains, and the recommendation."""
    out = io.StringIO()
    console = Console(file=out, width=WIDTH, force_terminal=colour, color_system="standard" if colour else None,
                      highlight=False, markup=False, emoji=False)
    for line in (f"{terminal(study.loop, 60)}: {headline(study)}", "", *assumptions(study), ""):
        console.print(terminal(line) if line else "")
    table = Table(box=None, pad_edge=False, header_style="bold", padding=(0, 2, 0, 0))
    for name in COLUMNS:
        table.add_column(name, justify="right", no_wrap=True)
    for trial in study.trials:
        table.add_row(*cells(study, trial), style="bold green" if trial.gain == study.recommended else "")
    console.print(table)
    console.print("\nErrors, travel and reversals relative to the loop without compensator (first line).")
    for note in study.refusals:
        console.print(f"against: {terminal(note.message)} ({note.code})")
    for note in study.warnings:
        console.print(f"warning: {terminal(note.message)} ({note.code})")
    console.print(f"\n{ADVICE}")
    return "\n".join(line.rstrip() for line in out.getvalue().splitlines()) + "\n"


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
                f"{100 * base.output_travel:.3g} %/h", f"{base.reversals:.3g} /h", yes_no(base.limit_cycle)]
    return [f"{100 * trial.gain:.2f} {mark}".strip(), f"{trial.gain / study.d:.2f}", percent(trial.iae, base.iae),
            percent(trial.peak, base.peak), percent(trial.travel, base.travel),
            percent(trial.output_travel, base.output_travel), percent(trial.reversals, base.reversals),
            yes_no(trial.limit_cycle)]


def percent(value: float, base: float) -> str:
    """Return the change from the base.

    >>> percent(0.8, 1.0), percent(3.0, 1.0), percent(0.999, 1.0)
    ('-20 %', '+200 %', '0 %')
    """
    if not base > 0.0:
        return "–"
    change = round(100.0 * (value / base - 1.0))
    return f"{change:+d} %" if change else "0 %"


def yes_no(value: bool) -> str:
    return "yes" if value else "no"


def to_document(study: CompensationStudy) -> dict[str, Any]:
    """Return the study as plain values for JSON; normalised signals, seconds."""
    model = study.process
    return {
        "schema_version": 1, "loop": study.loop, "settings": dict(study.settings),
        "dead_band": {"d": study.d, "ci95": list(study.interval), "source": study.d_source},
        "process": {"gain": model.gain, "lags": list(model.lags), "dead_time": model.dead_time,
                    "integrating": model.integrating, "source": model.source, "evidence": model.evidence},
        "output_noise": study.output_noise, "load": study.load,
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
    }
