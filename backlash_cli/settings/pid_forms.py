"""Controller settings in every common form, converted to the ideal form: K, Ti [s], Td [s].

Ideal (standard, ISA):     u = K ( e + 1/Ti ∫e dt + Td de/dt )
Series (interacting):      C = K' (1 + 1/(s Ti')) (1 + s Td')
Parallel (independent):    u = K e + Ki ∫e dt + Kd de/dt

Conversions: Åström and Hägglund, Advanced PID Control (ISA 2006), section 3.2.
Everything here is on one pair of signals: `units` and spans are handled where a record is scaled."""

import math
import re
from collections.abc import Mapping
from typing import Any, NamedTuple

from ..errors import MetadataError, nearest
from ..words import explained

FORMS = ("ideal", "series", "parallel")
RIVALS = (("K", "PB"), ("Ti", "Ki", "reset"), ("Td", "Kd"))  # keys that say the same
SECONDS = {"ms": 1e-3, "msec": 1e-3, "millisecond": 1e-3, "s": 1.0, "sec": 1.0, "second": 1.0, "m": 60.0, "min": 60.0,
           "minute": 60.0, "h": 3600.0, "hr": 3600.0, "hour": 3600.0}
_QUANTITY = re.compile(r"^\s*([+-]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][+-]?\d+)?)\s*(.*?)\s*$")
_RATE = re.compile(r"^(?:repeats?|reps?|r)?\s*(?:/|per\b|p(?=m$|s$))\s*(.+)$")


class Tuning(NamedTuple):
    """Ideal-form settings: gain K, integral time Ti [s] (None: not given), derivative time Td [s]."""

    K: float | None = None
    Ti: float | None = None
    Td: float = 0.0


def series_to_ideal(K: float, Ti: float, Td: float) -> Tuning:
    """Convert an interacting controller K' (1 + 1/(s Ti')) (1 + s Td') to the ideal form.

    >>> series_to_ideal(2.0, 8.0, 2.0)
    Tuning(K=2.5, Ti=10.0, Td=1.6)"""
    return Tuning(K * (Ti + Td) / Ti, Ti + Td, Ti * Td / (Ti + Td))


def number(value: Any, key: str) -> float:
    """Return a finite number, or raise MetadataError that names the key."""
    if isinstance(value, str):
        match = _QUANTITY.match(value)
        value = match[1].replace(",", ".") if match and not match[2] else value
    try:
        result = math.nan if isinstance(value, bool) else float(value)
    except (TypeError, ValueError, OverflowError):
        result = math.nan
    if not math.isfinite(result):
        raise MetadataError(**explained("no_number", key=key, value=repr(value)[:60]))
    return result


def seconds(value: Any, key: str) -> float:
    """Return a time in seconds from 28.0, "28 s", "0.5 min", "0.01 h" or, as repeats, "2 /min".

    >>> seconds("0.5 min", "Ti"), seconds("2 /min", "Ti")
    (30.0, 30.0)"""
    match = _QUANTITY.match(value) if isinstance(value, str) else None
    if match is None or not match[2]:
        return number(value, key)
    if _RATE.match(match[2].lower()):
        rate = per_second(value, key)
        if rate == 0.0:
            raise MetadataError(f"{key} must not be zero repeats", remedy="leave it out for a controller without reset")
        return 1.0 / rate
    return number(match[1], key) * _unit(match[2], key)


def per_second(value: Any, key: str) -> float:
    """Return a rate per second from 0.02, "0.02 /s", "2 /min" or "2 repeats per minute"."""
    match = _QUANTITY.match(value) if isinstance(value, str) else None
    if match is None or not match[2]:
        return number(value, key)
    if (rate := _RATE.match(match[2].lower())) is None:
        raise MetadataError(f"{key} = {value!r:.60} has no known unit", remedy=f'write {key} = "2 /min" or "0.03 /s"')
    return number(match[1], key) / _unit(rate[1], key)


def to_ideal(values: Mapping[str, Any]) -> Tuning:
    """Return ideal-form K, Ti, Td from the keys K, PB, Ti, reset, Ki, Td, Kd and form of one loop.

    PB is the proportional band in % (K = 100/PB). `reset` is an integral action in repeats per time and needs
    its unit. With form = "parallel", Ti and Td are the independent times 1/Ki and Kd.
    Raises MetadataError naming the key that is wrong."""
    form = str(values.get("form", "ideal")).strip().lower()
    if form not in FORMS:
        raise MetadataError(f"form = {values['form']!r:.60} is not known", remedy=nearest(form, FORMS))
    for rivals in RIVALS:
        if len(given := [key for key in rivals if key in values]) > 1:
            raise MetadataError(f"both {' and '.join(given)} are given", remedy="keep one of them")
    gain, parallel = _gain(values), form == "parallel"
    derivative = next((seconds(values[key], key) for key in ("Td", "Kd") if key in values), 0.0)
    of_gain = "Ki" in values, derivative and "Kd" in values, parallel and ({"Ti", "reset"} & set(values) or derivative)
    if gain is None and any(of_gain):
        raise MetadataError("Ki and Kd need the gain K (or PB)", remedy="add K, or give Ti and Td as times")
    size = abs(gain) if parallel and gain is not None else 1.0  # independent times have no sign
    integral = _integral(values, gain, size)
    derivative /= gain if gain is not None and "Kd" in values else size
    if derivative < 0:
        raise MetadataError("Td (or Kd/K) must not be negative", remedy="check the sign of the derivative setting")
    if form == "series" and derivative > 0:
        if gain is None or integral is None:
            raise MetadataError('form = "series" with Td needs K and Ti', remedy="give K, Ti and Td together")
        return series_to_ideal(gain, integral, derivative)
    return Tuning(gain, integral, derivative)


def _gain(values: Mapping[str, Any]) -> float | None:
    if "PB" in values:
        width = number(str(values["PB"]).replace("%", ""), "PB")
        if width == 0:
            raise MetadataError("PB must not be zero", remedy="PB is the proportional band in %, K = 100 / PB")
        return 100.0 / width
    gain = number(values["K"], "K") if "K" in values else None
    if gain == 0:
        raise MetadataError("K must not be zero", remedy="give the controller gain, or leave K out to identify it")
    return gain


def _integral(values: Mapping[str, Any], gain: float | None, size: float) -> float | None:
    """Return Ti [s]. size: K without its sign where times are independent of it, else 1."""
    if "Ki" in values:
        rate = per_second(values["Ki"], "Ki")
        if rate == 0:
            raise MetadataError("Ki must not be zero", remedy="the method needs integral action")
        if gain is not None and gain / rate <= 0:
            raise MetadataError("Ki must have the same sign as K", remedy="check the signs of K and Ki")
        return None if gain is None else gain / rate
    key = next((key for key in ("Ti", "reset") if key in values), None)
    if key is None:
        return None
    if key == "reset" and not (isinstance(values[key], str) and re.search(r"[a-zA-Z]", values[key])):
        raise MetadataError(**explained("no_unit", value=repr(values[key])[:60]))
    time = seconds(values[key], key)
    if time <= 0:
        raise MetadataError(**explained("not_positive", key=key, value=repr(values[key])[:60]))
    return time * size


def _unit(text: str, key: str) -> float:
    unit = text.strip().lower().rstrip(".")
    factor = SECONDS.get(unit, SECONDS.get(unit.removesuffix("s")))
    if factor is None:
        raise MetadataError(f"{key}: unknown time unit {text!r:.60}", remedy="use s, min or h")
    return factor
