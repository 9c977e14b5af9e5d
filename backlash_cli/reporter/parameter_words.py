"""How the parameters of a model are said to a person: units, intervals, and the sentence they stand in."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import groupby
from string import Formatter

from ..record import LoopSettings
from ..results import Candidate, FittedEffect, FittedParameter
from .json_report import iso_time
from .safe import terminal

SHOWN_EVENTS = 6  # of many times or sizes, before "and N more"
A_DATE = 1e8  # epoch seconds (1973); a record that counts its seconds from zero stays below
UNKNOWN = 1e4  # an interval this many times wider than its value says nothing
FASTEST = 10.0  # spans per second: no valve is that fast, so that nothing limits it
SWITCH = "0 or 1"  # unit of a parameter that is on or off


def quantity(
    p: FittedParameter, stage: str, settings: LoopSettings, start: float | None = None, *, brief: bool = False
) -> str:
    """A parameter with unit and interval, in engineering units too where the range is known; brief for a sentence.

    >>> d = FittedParameter(0.0302, "span", (0.0295, 0.031))
    >>> quantity(d, "valve", LoopSettings())
    '3.02 % of OP span (95 %: 2.95 to 3.10 %)'
    >>> quantity(d, "valve", LoopSettings(), brief=True)
    '3.02 %'
    """
    if isinstance(p.value, tuple):
        return _several(p, stage, settings, start, brief)
    if math.isinf(p.value):
        return "none"
    if p.unit == "1/s" and p.value > FASTEST:
        return "no limit that shows"
    interval = p.ci95 if p.ci95 and not isinstance(p.ci95[0], tuple) else None
    low, high = interval if interval else (math.nan, math.nan)
    if p.unit == SWITCH:
        return "yes" if p.value else "no"
    scale, unit, short = _unit(p.unit, stage)
    shown = _digits(p.value * scale, math.nan if brief else (high - low) * scale)
    said = f"{p.value * scale:.{shown}f}" if p.value else "0"
    if brief:
        return said + short
    said += unit
    if math.isfinite(low) and math.isfinite(high) and high - low > UNKNOWN * max(abs(p.value), 1e-9):
        said += " (95 %: not known from this record)"
    elif math.isfinite(low) and math.isfinite(high):
        digits = _digits(0.0, (high - low) * scale)
        said += f" (95 %: {low * scale:.{digits}f} to {high * scale:.{digits}f}{short.partition(' per ')[0]})"
    return said + _engineering(p, stage, settings)


def plain_quantity(p: FittedParameter) -> str:
    """A parameter of the process, without engineering units."""
    return quantity(p, "process", LoopSettings())


def _several(p: FittedParameter, stage: str, settings: LoopSettings, start: float | None, brief: bool) -> str:
    assert isinstance(p.value, tuple)
    if p.unit == "s" and start is not None and start > A_DATE:
        return clock_times([start + t for t in p.value])
    said = []
    for place, value in enumerate(p.value[:SHOWN_EVENTS]):
        own = p.ci95[place] if p.ci95 and place < len(p.ci95) else None
        interval = own if isinstance(own, tuple) else None
        one = FittedParameter(value, p.unit, interval)
        said.append(quantity(one, stage, settings, brief=brief))
    return ", ".join(said) + _more(len(p.value))


def clock_times(times: Sequence[float]) -> str:
    """Moments of events, the day said once.

    >>> clock_times([1773734400.0, 1773738000.5])
    '2026-03-17 08:00:00, 09:00:00 UTC'
    """
    stamps = [(iso_time(float(round(time))) or "–").rstrip("Z").partition("T") for time in times[:SHOWN_EVENTS]]
    days = groupby(stamps, key=lambda stamp: stamp[0])
    said = (f"{day} {', '.join(clock for *_, clock in stamps)}" for day, stamps in days)
    return ", ".join(said) + _more(len(times)) + " UTC"


def _more(count: int) -> str:
    return f" and {count - SHOWN_EVENTS} more" if count > SHOWN_EVENTS else ""


def _unit(unit: str, stage: str) -> tuple[float, str, str]:
    """Factor to the unit that is shown, its words, and its short form for an interval."""
    whose = "PV" if stage == "sensor" else "OP"
    known = {
        "span": (100.0, f" % of {whose} span", " %"),
        "OP span": (100.0, " % of OP span", " %"),
        "PV span": (100.0, " % of PV span", " %"),
        "1/h": (100.0, " % per hour", " % per hour"),
        "OP span/h": (100.0, " % of OP span per hour", " % per hour"),
        "1/s": (100.0, f" % of {whose} span per second", " % per second"),
        "OP span per column unit": (100.0, " % of OP span per unit of the column", " % per unit of the column"),
        "s": (1.0, " s", " s"),
        "1": (1.0, "", ""),
        "": (1.0, "", ""),
    }
    return known.get(unit, (1.0, f" {unit}", f" {unit}"))


def _digits(value: float, width: float) -> int:
    """Decimals worth showing: one digit of the interval's half width, at least two of the value; else three."""
    own = math.floor(math.log10(abs(value))) if value and math.isfinite(value) else 0
    if math.isfinite(width) and width > 0:
        worth = -math.floor(math.log10(0.5 * width))
        if value:
            worth = max(worth, 1 - own)
    else:
        worth = 2 - own
    return min(max(worth, 0), 8)


def _engineering(p: FittedParameter, stage: str, settings: LoopSettings) -> str:
    """The same amount in the units of the export, where a range is known and says something new."""
    assert not isinstance(p.value, tuple)
    whose = {"span": "PV" if stage == "sensor" else "OP", "OP span": "OP", "PV span": "PV"}.get(p.unit)
    if whose is None:
        return ""
    low, high = settings.pv_range if whose == "PV" else settings.op_range
    if (low, high) in ((0.0, 1.0), (0.0, 100.0)):
        return ""
    amount = p.value * (high - low) + (low if p.level else 0.0)
    return f", {amount:.3g} in {whose} units"


def numbers(
    effect: FittedEffect | Candidate, settings: LoopSettings, start: float | None = None, *, brief: bool = False
) -> dict[str, str]:
    """What to show of an effect: parameter name -> value with unit and interval; the start of the record left out."""
    shown = {"column": terminal(effect.column, 60)} if effect.column else {}
    for name, p in effect.parameters.items():
        off = p.unit == SWITCH and not p.value
        if not p.nuisance and not off and not (isinstance(p.value, float) and math.isinf(p.value)):
            shown[name] = quantity(p, effect.stage, settings, start, brief=brief)
    return shown


def said_numbers(effect: FittedEffect | Candidate, settings: LoopSettings, start: float | None = None, *,
                 brief: bool = False) -> str:
    """The same on one line."""
    return ", ".join(f"{k} = {v}" for k, v in numbers(effect, settings, start, brief=brief).items())


def events(
    effect: FittedEffect, settings: LoopSettings, start: float | None
) -> tuple[list[str], list[list[str]]] | None:
    """An effect of several events as columns and rows, one event in a row; None for any other."""
    lists = {n: p for n, p in effect.parameters.items() if isinstance(p.value, tuple) and not p.nuisance}
    counts = {len(p.value) for p in lists.values() if isinstance(p.value, tuple)}
    if len(lists) < 2 or len(counts) != 1:
        return None

    def one(p: FittedParameter, i: int) -> str:
        assert isinstance(p.value, tuple)
        own = None if p.ci95 is None else (p.ci95[i],)
        only = replace(p, value=(p.value[i],), ci95=own)  # type: ignore[arg-type]
        return quantity(only, effect.stage, settings, start)

    return list(lists), [[one(p, i) for p in lists.values()] for i in range(counts.pop())]


def several(effect: FittedEffect, settings: LoopSettings) -> str:
    """An effect of several events in few words: how many, and the largest; empty for any other.

    >>> times, sizes = FittedParameter((60.0, 90.0), "s"), FittedParameter((0.02, -0.031), "OP span")
    >>> several(FittedEffect("load_step", {"times": times, "sizes": sizes}), LoopSettings())
    'at 2 times, up to -3.10 %'
    """
    lists = [p for p in effect.parameters.values() if isinstance(p.value, tuple) and not p.nuisance]
    amounts = [(v, p) for p in lists if p.unit != "s" and isinstance(p.value, tuple) for v in p.value]
    if len(lists) < 2 or not amounts:
        return ""
    value, p = max(amounts, key=lambda one: abs(one[0]))
    count = len(amounts)
    largest = quantity(FittedParameter(value, p.unit), effect.stage, settings, brief=True)
    return f"at {count} time{'s' * (count != 1)}, {'up to' if count != 1 else 'by'} {largest}"


def meaning(effect: FittedEffect, settings: LoopSettings, start: float | None = None) -> str:
    """The sentence that says what an effect means in this plant, its numbers filled in."""
    values = {n: quantity(p, effect.stage, settings, start, brief=True) for n, p in effect.parameters.items()}
    values["column"] = terminal(effect.column, 60)
    return fill(effect.meaning or effect.sentence, values)


def fill(template: str, values: Mapping[str, str]) -> str:
    """Put values into the {name} places of a sentence; of a name that is not known it says so.

    >>> fill("The gap is {d}, {x}.", {"d": "3 %"})
    'The gap is 3 %, none.'
    """
    try:
        pieces = list(Formatter().parse(template))
    except ValueError:
        return template.replace("{", "").replace("}", "")
    return "".join(text + ("" if name is None else values.get(name, "none")) for text, name, _, _ in pieces)
