"""An effect with the values of its parameters, as a scenario and a recorder use it."""

from __future__ import annotations

from dataclasses import dataclass

from ..effects.shape import Effect
from ..record import FloatArray


@dataclass(frozen=True, eq=False)
class Applied:
    """An effect with its parameter array; `column` names the measured signal of an effect that takes one."""

    effect: Effect
    p: FloatArray
    column: str | None = None


def use(name: str | Effect, *, column: str | None = None, **parameters: object) -> Applied:
    """Return an effect with its parameters, for example use("backlash", d=0.03).

    name: a name of `backlash effects`, `module:NAME`, or an Effect. Raises MetadataError for what does not exist.
    """
    from ..effects.registry import load_effect

    effect = name if isinstance(name, Effect) else load_effect(name)
    return Applied(effect, effect.pack(parameters), column)
