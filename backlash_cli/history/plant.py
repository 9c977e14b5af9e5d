"""The whole history at once: every loop's nights, its wear, and the order of repair."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ..errors import UsageError, nearest
from ..results.history import Night, Place, Wear
from .limits import Limits
from .ranking import HORIZON, rank
from .store import History
from .trend import wear


@dataclass(frozen=True)
class PlantHistory:
    """Nights and wear by loop, in the order of repair given by `places`."""

    nights: dict[str, list[Night]]
    wears: dict[str, Wear]
    places: list[Place]


def plant_history(history: History, limits: Limits, *, loops: Sequence[str] = (),
                  horizon: float = HORIZON) -> PlantHistory:
    """Read a history and work out wear and ranking of all loops, or of the named ones."""
    known = history.loops()
    for name in loops:
        if name not in known:
            raise UsageError(f"the history has no loop {name!r}", where=str(history.path), remedy=nearest(name, known))
    nights = {name: history.nights(name) for name in known if not loops or name in loops}
    wears = {name: wear(name, found, history.repairs(name), limits.of(name)) for name, found in nights.items()}
    return PlantHistory(nights, wears, rank(list(wears.values()), nights, horizon))
