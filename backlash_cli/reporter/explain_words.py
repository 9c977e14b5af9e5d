"""How errors, parameters and effects of a model are said to a person, the same in the terminal and on a page."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from string import Formatter

from ..record import LoopSettings
from ..results import Candidate, Comparison, Explanation, FittedEffect, FittedParameter, Step
from .json_report import iso_time
from .safe import terminal
from .words import duration, moment

SHOWN_EVENTS = 6  # of many times or sizes, before "and N more"
ABOUT = 0.1  # errors closer than this share say the same
SWITCH = "0 or 1"  # unit of a parameter that is on or off
MUCH = 2.0  # error over noise from which "nothing is missing" needs a word more
A_DATE = 1e8  # epoch seconds (1973); a record that counts its seconds from zero stays below


def error_size(value: float | None) -> str:
    """An error in per cent of the measurement span with three digits, e.g. '0.812 %'."""
    return "–" if value is None or not math.isfinite(value) else f"{100 * value:.3g} %"


def share(value: float | None) -> str:
    """A share of a whole in whole per cent, e.g. '41 %'; two digits of small ones."""
    if value is None or not math.isfinite(value):
        return "–"
    if abs(value) >= 0.0995 or abs(value) < 0.0005:
        return f"{100 * value:.0f} %"
    return f"{100 * value:.2g} %"


def plain_name(effect: str) -> str:
    """The name of an effect in words: 'dead time' for dead_time."""
    return terminal(effect.replace("_", " "), 60)


def ladder(steps: Sequence[Step], noise_floor: float) -> str:
    """The ladder in one line.

    >>> ladder([Step(None, 0.032), Step("dead_time", 0.021), Step("backlash", 0.008)], 0.0075)
    'baseline 3.2 % -> + dead time 2.1 % -> + backlash 0.8 % (noise floor 0.75 %)'
    """
    rungs = [
        f"{'baseline' if step.added is None else '+ ' + plain_name(step.added)} {error_size(step.rmse_holdout)}"
        for step in steps
    ]
    return f"{' -> '.join(rungs)} (noise floor {error_size(noise_floor)})"


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
    interval = p.ci95 if p.ci95 and not isinstance(p.ci95[0], tuple) else None
    low, high = interval if interval else (math.nan, math.nan)
    if p.unit == SWITCH:
        return "yes" if p.value else "no"
    scale, unit, short = _unit(p.unit, stage)
    said = f"{p.value * scale:.{_digits(p.value * scale, math.nan if brief else (high - low) * scale)}f}"
    if brief:
        return said + short
    said += unit
    if math.isfinite(low) and math.isfinite(high):
        digits = _digits(0.0, (high - low) * scale)
        said += f" (95 %: {low * scale:.{digits}f} to {high * scale:.{digits}f}{short.partition(' per ')[0]})"
    return said + _engineering(p, stage, settings)


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
    said: list[str] = []
    day = ""
    for time in times[:SHOWN_EVENTS]:
        today, _, clock = (iso_time(float(round(time))) or "–").rstrip("Z").partition("T")
        said.append(clock if today == day else f"{today} {clock}")
        day = today
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
        "OP span/h": (100.0, " % of OP span per hour", " % per hour"),
        "1/s": (100.0, " % of OP span per second", " % per second"),
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
        if not p.nuisance and not (isinstance(p.value, float) and math.isinf(p.value)):
            shown[name] = quantity(p, effect.stage, settings, start, brief=brief)
    return shown


def meaning(effect: FittedEffect, settings: LoopSettings, start: float | None = None) -> str:
    """The sentence that says what an effect means in this plant, its numbers filled in."""
    values = {n: quantity(p, effect.stage, settings, start, brief=True) for n, p in effect.parameters.items()}
    values["column"] = terminal(effect.column, 60)
    return fill(effect.meaning or effect.sentence, values)


def fill(template: str, values: Mapping[str, str]) -> str:
    """Put values into the {name} places of a sentence; a name that is not known stays as it is.

    >>> fill("The gap is {d}, {x}.", {"d": "3 %"})
    'The gap is 3 %, {x}.'
    """
    try:
        pieces = list(Formatter().parse(template))
    except ValueError:
        return template
    return "".join(text + ("" if name is None else values.get(name, f"{{{name}}}")) for text, name, _, _ in pieces)


def look_alike_words(explanation: Explanation) -> list[str]:
    """One sentence for each pair of effects that this record cannot tell apart."""
    return [
        f"{plain_name(a)} and {plain_name(b)} explain this record about equally well: it cannot tell them apart."
        for a, b in explanation.look_alikes
    ]


def candidate_verdict(explanation: Explanation, candidate: Candidate) -> str:
    """What became of an effect that was tried, in a word or two."""
    for accepted, other in explanation.look_alikes:
        if candidate.effect == other:
            return f"looks like {plain_name(accepted)}"
    return candidate.verdict


def verdict(explanation: Explanation) -> str:
    """The answer in one sentence."""
    if explanation.verdict:
        return explanation.verdict
    added = explanation.steps[1:]
    names = " and ".join(plain_name(s.added or "") for s in added if s.chosen == "search")
    own = " and ".join(plain_name(s.added or "") for s in added if s.chosen != "search")
    said = []
    if own:
        said.append(
            f"With your own choice, {own}, the error on unseen samples goes from "
            f"{error_size(explanation.steps[0].rmse_holdout)} to {error_size(_after_own(added))}."
        )
    if names:
        with_it = "it" if sum(s.chosen == "search" for s in added) == 1 else "them"
        model = "model" if own else "plain model"
        said.append(f"Missing in the {model}: {names}. The error on unseen samples falls with {with_it}.")
    if not added:
        said.append("Nothing is missing: no effect that was tried predicts this record better than the plain model.")
        times = explanation.baseline.rmse_holdout / max(explanation.noise_floor, 1e-12)
        if times > MUCH:
            said.append(f"The error is {times:.2g} times the noise, though: what remains is load that nobody measured, "
                        "or something that is not among the effects.")
    return " ".join(said)


def _after_own(added: Sequence[Step]) -> float:
    """The error after the last step of the user's own choice."""
    return [s.rmse_holdout for s in added if s.chosen != "search"][-1]


def still_holds(c: Comparison) -> str:
    """Whether a model that was kept predicts this record too; empty where no model was given."""
    if c.fitted or c.model is None:
        return ""
    before = c.model.rmse_holdout
    said = "" if before is None else (
        f"On the record it was fitted to its error was {error_size(before)}, here it is {error_size(c.fitness.rmse)}. "
    )
    ratio = c.fitness.rmse / c.baseline.rmse if c.baseline.rmse > 0 else math.inf
    if ratio < 1.0 - ABOUT:
        return said + "The model holds here: it predicts this record better than a plain model fitted to it."
    if ratio < 1.0 + ABOUT:
        return said + "It predicts this record about as well as a plain model fitted to it."
    return said + "The model does not hold here: a plain model fitted to this record does better."


def span_words(found: Comparison | Explanation) -> str:
    """Which record this is about: from when to when, how many samples, how far apart."""
    series = found.series
    if series is None or len(series.time) == 0:
        return ""
    used = int(series.used.sum())
    every = duration(float(series.time[1] - series.time[0])) if len(series.time) > 1 else "–"
    return f"{moment(float(series.time[0]))} to {moment(float(series.time[-1]))}, {used} samples, every {every}"
