"""From what the metadata say about a loop to LoopSettings: ideal form, seconds, checked."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ..errors import MetadataError
from ..record import LoopSettings, Note
from .pid_forms import number, seconds, to_ideal
from .schema import LoopValues


@dataclass(frozen=True)
class Settings:
    """Settings of one loop before the data are seen.

    loop: K and Kp as given (see `engineering`), times in seconds. pv_range, op_range: None when not given.
    engineering: K and Kp are in output units per measurement unit and back. notes: what was assumed.
    """

    loop: LoopSettings
    pv_range: tuple[float, float] | None = None
    op_range: tuple[float, float] | None = None
    engineering: bool = False
    auto_modes: tuple[str, ...] = ()
    constant_setpoint: float | None = None
    notes: tuple[Note, ...] = ()


def settings_of(values: LoopValues | None) -> Settings:
    """Check and convert the settings of one loop. Raises MetadataError naming the key, the value and the remedy."""
    if values is None:
        return Settings(LoopSettings())
    given = values.values
    tuning = to_ideal(given)
    notes: list[Note] = []
    times = {key: seconds(given[key], key) for key in ("Tf", "theta") if key in given}
    for key, value in times.items():
        if value < 0:
            raise MetadataError(f"{key} must not be negative, not {value:g}", remedy=f"give {key} in seconds")
    gain = number(given["Kp"], "Kp") if "Kp" in given else None
    if gain == 0:
        raise MetadataError("Kp (static process gain) must not be zero",
                            remedy="give the gain, or leave Kp out for the default 1.5")
    if gain is not None and tuning.K is not None and gain * tuning.K < 0:
        gain = -gain
        notes.append(Note("kp_sign", f"Kp has the opposite sign of K, with which no loop is stable: taken as {gain:g}"))
    units = str(given.get("units", "normalised")).lower()
    if units not in ("normalised", "normalized", "engineering"):
        raise MetadataError(f"units = {given['units']!r} is not known", remedy='units is "normalised" or "engineering"')
    named = {"PB": "K", "Ki": "Ti", "reset": "Ti", "Kd": "Td"}
    keys = ("Tf", "Kp", "theta", "pv_range", "op_range", "K", "PB", "Ti", "Ki", "reset", "Td", "Kd")
    source = {named.get(key, key): "default" if key in values.from_defaults else "metadata"
              for key in keys if key in given}
    setpoint = given.get("sp")
    loop = LoopSettings(K=tuning.K, Ti=tuning.Ti, Td=tuning.Td, Tf=times.get("Tf"), Kp=gain, theta=times.get("theta"),
                        source=source)
    return Settings(loop, _range(given, "pv_range"), _range(given, "op_range"), units == "engineering",
                    _words(given.get("auto_modes", ())),
                    number(setpoint, "sp") if isinstance(setpoint, (int, float)) else None, tuple(notes))


def _range(given: Any, key: str) -> tuple[float, float] | None:
    if key not in given:
        return None
    value = given[key]
    if not isinstance(value, (list, tuple)) or len(value) != 2:
        raise MetadataError(f"{key} must be two numbers, not {value!r}", remedy=f"write {key} = [0, 100]")
    low, high = number(value[0], key), number(value[1], key)
    if low == high:
        raise MetadataError(f"{key} = [{low:g}, {high:g}] has zero width", remedy="give the span: [low, high]")
    if low > high:
        raise MetadataError(f"{key} = [{low:g}, {high:g}] is reversed: low must be less than high",
                            remedy=f"[{high:g}, {low:g}]?")
    if high - low == float("inf"):
        raise MetadataError(f"{key} is too wide", remedy="give the span: [low, high]")
    return low, high


def _words(value: Any) -> tuple[str, ...]:
    items = value if isinstance(value, (list, tuple)) else [value]
    return tuple(str(item) for item in items)
