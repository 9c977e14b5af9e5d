"""What a scenario planted, as plain rows: the answer that a scan or an explanation of its record should find."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from .applied import Applied
from .scenario import Scenario

Row = tuple[str, str, str, str, str]


def truth_rows(scenarios: Iterable[Scenario]) -> list[Row]:
    """Return rows (loop, effect, parameter, value, unit), normalised; lists are joined by semicolons."""
    return [row for scenario in scenarios for row in _rows(scenario)]


def _rows(s: Scenario) -> Iterator[Row]:
    process = s.process
    yield s.name, "process", "gain", _text(process.gain), "PV span/OP span" + ("/s" if process.integrating else "")
    if process.lags:
        yield s.name, "process", "lags", _text(*process.lags), "s"
    if len(process.denominator) > 1:
        yield s.name, "process", "numerator", _text(*process.numerator), "1"
        yield s.name, "process", "denominator", _text(*process.denominator), "1"
    yield s.name, "process", "dead_time", _text(process.dead_time), "s"
    yield s.name, "process", "integrating", str(int(process.integrating)), "0 or 1"
    for applied in s.effects:
        yield from _effect(s.name, "", applied)
    for applied in s.setpoint.effects:
        yield from _effect(s.name, "setpoint:", applied)
    for recorder in s.recorder:
        yield from _effect(s.name, "recorder:", recorder.applied)
    if s.compensator.gain > 0.0:
        yield s.name, "compensator", "gain", _text(s.compensator.gain), "span"
        yield s.name, "compensator", "scheme", str(int(s.compensator.scheme)), "equation"


def _effect(loop: str, place: str, applied: Applied) -> Iterator[Row]:
    lists = [q for q in applied.effect.parameters if q.many]
    width = (len(applied.p) - len(applied.effect.parameters) + len(lists)) // max(len(lists), 1)
    at = 0
    for q in applied.effect.parameters:
        size = width if q.many else 1
        values = applied.p[at : at + size]
        at += size
        if values.size and (not (q.nuisance or q.choices) or values[0] != q.neutral):
            # the same effect on a setpoint adds to the measurement's span
            unit = q.unit.replace("OP span", "PV span") if place == "setpoint:" else q.unit
            yield loop, place + applied.effect.name, q.name, _text(*values), unit
    if applied.column is not None:
        yield loop, place + applied.effect.name, "column", applied.column, ""


def _text(*values: float) -> str:
    return ";".join(f"{v:.10g}" for v in values)
