"""A process as a person writes it: `K=1.3,T=20,L=2`, or a TOML file with gain, lags and dead time."""

from __future__ import annotations

from pathlib import Path

from ..errors import MetadataError, nearest
from .process import Process
from .scenario_file import build, read_toml

NAMES = {"k": "gain", "kp": "gain", "gain": "gain", "t": "lag", "t1": "lag", "t2": "lag", "t3": "lag", "t4": "lag",
         "tau": "lag", "tau1": "lag", "tau2": "lag", "l": "dead_time", "theta": "dead_time", "dead_time": "dead_time"}
WHERE = "--process"
REMEDY = "for example --process K=1.3,T=20,L=2 (static gain, lag and dead time in seconds; more lags: T2=..)"


def parse_process(text: str) -> Process:
    """Return the process of `K=..,T=..,L=..` or of a TOML file.

    Raises MetadataError for unknown names, what is no number, and processes that cannot be.

    >>> parse_process("K=1.3, T=20, T2=3, L=2")
    Process(gain=1.3, lags=(20.0, 3.0), dead_time=2.0, integrating=False, numerator=(1.0,), denominator=(1.0,))
    """
    if text.endswith(".toml"):
        table = read_toml(Path(text))
        return build(Process, table.get("process", table), text)
    gain, dead_time, lags = 1.0, 0.0, []
    seen: set[str] = set()
    for part in filter(None, (p.strip() for p in text.replace(";", ",").split(","))):
        name, equals, value = (x.strip() for x in part.partition("="))
        kind = NAMES.get(name.lower())
        if not equals or kind is None:
            hint = f"{nearest(name, ['K', 'T', 'T2', 'L'])} " if equals else ""
            raise MetadataError(f"'{part}' is not understood", where=WHERE, remedy=hint + REMEDY)
        if name.lower() in seen:
            raise MetadataError(f"{name} is given twice", where=WHERE, remedy=REMEDY)
        seen.add(name.lower())
        number = _number(value, name)
        if kind == "gain":
            gain = number
        elif kind == "dead_time":
            dead_time = number
        else:
            lags.append(number)
    if not lags:
        raise MetadataError("no lag is given", where=WHERE, remedy=REMEDY)
    return Process(gain=gain, lags=tuple(lags), dead_time=dead_time)


def _number(value: str, name: str) -> float:
    text = value.lower().removesuffix("s").strip()
    try:
        return float(text)
    except ValueError:
        raise MetadataError(f"{name} = '{value}' is not a number", where=WHERE, remedy=REMEDY) from None


def parse_dead_band(text: str, where: str = "--dead-band") -> float:
    """Return a dead band in spans of the output from `0.03` or `3%`. where: the option that gives it.

    Raises MetadataError for what is no number or not between 0 and half of the span.

    >>> parse_dead_band("0.03"), parse_dead_band("3 %")
    (0.03, 0.03)
    """
    remedy = "0.03 or 3% is 3 % of the output span"
    try:
        size = float(text.removesuffix("%")) / (100.0 if text.endswith("%") else 1.0)
    except ValueError:
        raise MetadataError(f"'{text}' is not a size", where=where, remedy=remedy) from None
    if not 0.0 < size <= 0.5:
        raise MetadataError(f"{text} is not possible", where=where, remedy=f"above 0, at most 0.5; {remedy}")
    return size
