"""How verdicts, sizes, times, errors and effects are said to a person, the same on a terminal and on a page."""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import groupby
from operator import itemgetter

from ..record import LoopSettings
from ..results import Explanation, FittedEffect, FittedParameter, LoopReport, Region, Step, Verdict
from ..words import WORDS
from .json_report import iso_time
from .safe import counted, terminal

# words, in the order of a work list; and good, warn, bad, quiet: the mark of a page and the colour of a terminal
VERDICTS = {**{verdict: verdict.replace("_", " ") for verdict in Verdict}, Verdict.INSUFFICIENT_DATA: "too little data",
            Verdict.ERROR: "not analysed"}
MARKS = dict(zip(VERDICTS, ("bad", "warn", "good", "warn", "quiet", "quiet", "bad"), strict=True))
TITLES, TO_DO = WORDS["titles"], WORDS["to_do"]  # of what to do with a valve, and the same in short
WORSE = 1.15  # share of the error over share of the time, from which a region is worth a line
SHOWN_EVENTS = 6  # of many times or sizes, before "and N more"
A_DATE = 1e8  # epoch seconds (1973); a record that counts its seconds from zero stays below
UNKNOWN = 1e4  # an interval this many times wider than its value says nothing
FASTEST = 10.0  # spans per second: no valve is that fast, so that nothing limits it
SWITCH = "0 or 1"  # unit of a parameter that is on or off


def by_size(reports: Sequence[LoopReport]) -> list[LoopReport]:
    """Reports in the order of a work list: backlash and suspicion by size, then the rest by verdict and name."""
    return sorted(reports, key=lambda r: ([*VERDICTS].index(r.verdict), -(size(r) or 0.0), r.loop))


def size(report: LoopReport) -> float | None:
    """Dead band to quote [span of output]: the cluster's; None where the verdict claims none."""
    claimed = report.verdict in (Verdict.BACKLASH, Verdict.SUSPECTED)
    return report.cluster.d if claimed and report.cluster is not None else None


def excluded(report: LoopReport) -> float | None:
    """Smallest dead band [span of output] that `no backlash` excludes; None where the verdict excludes none."""
    return report.limit_of_detection if report.verdict is Verdict.NO_BACKLASH else None


def in_percent(value: float, digits: int = 2) -> str:
    """A number in per cent, for a column that says so, e.g. '3.02'."""
    return f"{100 * value:.{digits}f}"


def percent(value: float | None, digits: int = 2) -> str:
    """A share of the span in per cent, e.g. '3.02 %'."""
    return "–" if value is None else f"{in_percent(value, digits)} %"


def interval(ci95: tuple[float, float]) -> str:
    """An interval in per cent, e.g. '2.85 to 3.20 %'."""
    return " to ".join(map(in_percent, ci95)) + " %"


def change(value: float, base: float) -> str:
    """How far a value is from the one without compensator, e.g. '-20 %', '+200 %', '0 %'."""
    more = round(100.0 * (value / base - 1.0)) if base > 0.0 else None
    return "–" if more is None else f"{more:+d} %".replace("+0", "0")


def moment(epoch: float | None) -> str:
    """A time as '2026-03-17 08:00 UTC'."""
    return (text[:16].replace("T", " ") + " UTC") if (text := iso_time(epoch)) else "–"


def day(epoch: float) -> str | None:
    """A day, e.g. '2026-03-17'; None outside the calendar (a limit that is thousands of years away)."""
    return (iso_time(epoch) or "")[:10] or None


def advice(report: LoopReport) -> str:
    """What to do about a dead band, or the first reason where there is none to be sure of, in one line."""
    if report.verdict is Verdict.BACKLASH:
        gain = report.compensator and f"repair, or compensate {percent(report.compensator.gain)} (by error sign)"
        return gain or "repair; a compensator is not advised"
    return report.reasons[0].message if report.reasons else ""


def error_size(value: float | None) -> str:
    """An error in per cent of the measurement span with three digits, e.g. '0.812 %'."""
    return "–" if value is None or not math.isfinite(value) else f"{100 * value:.3g} %"


def share(value: float | None) -> str:
    """A share of a whole in whole per cent, e.g. '41 %'; two digits of small ones."""
    if value is None or not math.isfinite(value):
        return "–"
    return f"{100 * value:.2g} %" if 0.0005 <= abs(value) < 0.0995 else percent(value, 0)


def plain_name(effect: str) -> str:
    """The name of an effect in words: 'dead time' for dead_time."""
    return terminal(effect.replace("_", " "), 60)


def rung(step: Step) -> str:
    """What a step of the ladder added: 'plain model', '+ dead time'."""
    return "plain model" if step.added is None else f"+ {plain_name(step.added)}"


def effect_name(effect: str, e: Explanation) -> str:
    """The name of an accepted effect, with look-alikes that the record cannot tell apart; whether it is likely."""
    sure = next((x.confidence for x in e.effects if x.effect == effect), "")
    twins = [b for a, b in e.look_alikes if a == effect and sure != "stand_in"]
    return " or ".join(plain_name(name) for name in sorted([effect, *twins])) + " (likely)" * (sure == "likely")


def fails(regions: Sequence[Region]) -> list[Region]:
    """The regions whose share of the error is clearly larger than their share of the time, worst first."""
    return [r for r in regions if r.expected is None or r.share >= WORSE * r.expected]


def quantity(p: FittedParameter, stage: str, settings: LoopSettings, start: float | None = None, *,
             brief: bool = False) -> str:
    """A parameter with unit and interval, in engineering units too where the range is known; brief for a sentence.

    start: epoch seconds from which the times of several events count.

    >>> quantity(FittedParameter(0.0302, "span", (0.0295, 0.031)), "valve", LoopSettings())
    '3.02 % of OP span (95 %: 2.95 to 3.10 %)'"""
    if isinstance(p.value, tuple):
        if p.unit == "s" and start is not None and start > A_DATE:
            return clock_times([start + t for t in p.value])
        said = (quantity(one, stage, settings, brief=brief) for one in _each(p)[:SHOWN_EVENTS])
        return ", ".join(said) + _more(p.value)
    if math.isinf(p.value):
        return "none"
    if p.unit == "1/s" and p.value > FASTEST:
        return "no limit that shows"
    if p.unit == SWITCH:
        return "yes" if p.value else "no"
    whose = "PV" if p.unit == "PV span" or (stage == "sensor" and not p.unit.startswith("OP")) else "OP"
    scale, unit = WORDS["units"].get(p.unit, (1.0, f" {p.unit}"))
    short = unit.replace(" of {} span", "")
    low, high = (scale * end for end in p.ci95) if p.ci95 else (math.nan, math.nan)
    value, width = scale * p.value, high - low
    shown = f"{value:.{_digits(value, math.nan if brief else width)}f}" if value else "0"
    if brief:
        return shown + short
    shown += unit.replace("{}", whose)
    if width > UNKNOWN * max(abs(value), 1e-9 * scale):
        shown += " (95 %: not known from this record)" * math.isfinite(width)
    elif math.isfinite(width):
        digits = _digits(0.0, width)
        shown += f" (95 %: {low:.{digits}f} to {high:.{digits}f}{short.partition(' per ')[0]})"
    zero, full = settings.pv_range if whose == "PV" else settings.op_range
    if unit.endswith("span") and (zero, full) not in ((0.0, 1.0), (0.0, 100.0)):
        shown += f", {p.value * (full - zero) + (zero if p.level else 0.0):.3g} in {whose} units"
    return shown


def _each(p: FittedParameter) -> list[FittedParameter]:
    assert isinstance(p.value, tuple)
    return [replace(p, value=v, ci95=p.ci95 and p.ci95[i]) for i, v in enumerate(p.value)]  # type: ignore[arg-type]


def clock_times(times: Sequence[float]) -> str:
    """Moments of events, the day said once: '2026-03-17 08:00:00, 09:00:00 UTC'."""
    stamps = [(iso_time(float(round(time))) or "–").rstrip("Z").partition("T") for time in times[:SHOWN_EVENTS]]
    said = (f"{day} {', '.join(clock for *_, clock in stamps)}" for day, stamps in groupby(stamps, itemgetter(0)))
    return ", ".join(said) + _more(times) + " UTC"


def _more(values: Sequence[float]) -> str:
    return f" and {len(values) - SHOWN_EVENTS} more" if len(values) > SHOWN_EVENTS else ""


def _digits(value: float, width: float) -> int:
    """Decimals worth showing: one digit of the interval's half width, at least two of the value; else three."""
    own = math.floor(math.log10(abs(value))) if value and math.isfinite(value) else 0
    worth = 2 - own
    if math.isfinite(width) and width > 0:
        worth = max(-math.floor(math.log10(0.5 * width)), 1 - own if value else 0)
    return min(max(worth, 0), 8)


def numbers(effect: FittedEffect, settings: LoopSettings, start: float | None = None, *, brief: bool = False
            ) -> dict[str, str]:
    """What to show of an effect: parameter name -> value with unit and interval; the start of the record left out."""
    column = {"column": terminal(effect.column, 60)} if effect.column else {}
    off = (math.inf, -math.inf)
    return column | {name: quantity(p, effect.stage, settings, start, brief=brief)
                     for name, p in effect.parameters.items()
                     if not p.nuisance and p.value not in off and (p.value or p.unit != SWITCH)}


def said_numbers(one: FittedEffect, settings: LoopSettings, start: float | None = None, *, brief: bool = False) -> str:
    """The same on one line."""
    return ", ".join(f"{k} = {v}" for k, v in numbers(one, settings, start, brief=brief).items())


def events(effect: FittedEffect, settings: LoopSettings, start: float | None
           ) -> tuple[list[str], list[tuple[str, ...]]] | None:
    """An effect of several events as columns and rows, one event in a row; None for any other."""
    lists = {n: p for n, p in effect.parameters.items() if isinstance(p.value, tuple) and not p.nuisance}
    if len(lists) < 2 or len({len(_each(p)) for p in lists.values()}) > 1:
        return None
    # as several of one, for times of day
    columns = [[quantity(replace(one, value=(one.value,), ci95=one.ci95 and (one.ci95,)),  # type: ignore[arg-type]
                         effect.stage, settings, start) for one in _each(p)] for p in lists.values()]
    return list(lists), list(zip(*columns, strict=True))


def several(effect: FittedEffect, settings: LoopSettings) -> str:
    """An effect of several events in few words: how many, and the largest; empty for any other.

    >>> times, sizes = FittedParameter((60.0, 90.0), "s"), FittedParameter((0.02, -0.031), "OP span")
    >>> several(FittedEffect("load_step", {"times": times, "sizes": sizes}), LoopSettings())
    'at 2 times, up to -3.10 %'"""
    lists = [p for p in effect.parameters.values() if isinstance(p.value, tuple) and not p.nuisance]
    amounts = [one for p in lists if p.unit != "s" for one in _each(p)]
    if len(lists) < 2 or not amounts:
        return ""
    largest = quantity(max(amounts, key=lambda one: abs(one.value)), effect.stage, settings,  # type: ignore[arg-type]
                       brief=True)
    return f"at {counted(len(amounts), 'time')}, {'up to' if len(amounts) != 1 else 'by'} {largest}"


def meaning(effect: FittedEffect, settings: LoopSettings, start: float | None = None) -> str:
    """The sentence that says what an effect means in this plant, its numbers filled in."""
    values = {n: quantity(p, effect.stage, settings, start, brief=True) for n, p in effect.parameters.items()}
    return fill(effect.meaning or effect.sentence, {**values, "column": terminal(effect.column, 60)})


def fill(template: str, values: Mapping[str, str]) -> str:
    """Put values into the {name} places of a sentence; of a name that is not known it says so.

    >>> fill("The gap is {d}, {x}.", {"d": "3 %"})
    'The gap is 3 %, none.'"""
    filled = re.sub(r"\{(\w*)[^{}]*\}", lambda place: values.get(place[1], "none"), template)
    return re.sub("[{}]", "", filled)
