"""The effects of a loop laid out for the kernel, and their series: measured columns and random numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..effects.shape import Stage
from ..errors import MetadataError, nearest
from ..record import FloatArray
from .applied import Applied
from .scenario import Scenario


class Numbers:
    """Hands out independent random generators in a fixed order, all from one seed."""

    def __init__(self, seed: int) -> None:
        self._seed, self._used = seed, 0

    def normal(self, size: int) -> FloatArray:
        """Return (size,) standard normal numbers of the next generator."""
        self._used += 1
        return np.random.default_rng([self._seed, self._used]).standard_normal(size)


def series(applied: Applied, samples: int, columns: Mapping[str, FloatArray], random: Numbers) -> FloatArray:
    if applied.effect.draws:
        return random.normal(applied.effect.draws * (samples + 1))
    if not applied.effect.column:
        return np.empty(0)
    if applied.column is None or applied.column not in columns:
        raise MetadataError(
            f"{applied.effect.name} needs a measured column, not '{applied.column}'",
            remedy=nearest(str(applied.column), columns),
        )
    return columns[applied.column]


@dataclass(frozen=True, eq=False)
class Table:
    """The loop's effects laid out for the kernel: flat states and parameters, and where each effect's begin."""

    steps: tuple[Any, ...]
    state_at: NDArray[np.int64]
    p_at: NDArray[np.int64]
    ends: NDArray[np.int64]
    states: FloatArray
    p: FloatArray
    rest: float
    compiled: bool

    @classmethod
    def build(cls, s: Scenario, samples: int, columns: Mapping[str, FloatArray], random: Numbers) -> Table:
        """Start every effect at rest, in the order a signal meets them."""
        from ..effects.compiled import compiled
        from ..kernels import SLOTS

        order = list(Stage)
        chain = sorted(s.effects, key=lambda a: order.index(a.effect.stage))
        if len(chain) > SLOTS:
            raise MetadataError(f"{len(chain)} effects in one loop", where=s.name, remedy=f"at most {SLOTS}")
        value, rest, states = s.output, s.output, []
        for applied in chain:
            if applied.effect.stage is Stage.SENSOR:
                value = s.setpoint.level
            state = applied.effect.begin(applied.p, s.step, value, series(applied, samples, columns, random))
            states.append(state)
            if applied.effect.stage in order[:3]:
                value = rest = float(applied.effect.step(state.copy(), value, applied.p))
        stages = [a.effect.stage for a in chain]
        ends = [sum(stage in upto for stage in stages) for upto in (order[:3], order[:4], order)]
        machine = [compiled(a.effect.step) for a in chain]
        ready = all(m is not None for m in machine)
        steps: Sequence[Any] = machine if ready else [a.effect.step for a in chain]
        idle = compiled(_idle)
        return cls(
            steps=(*steps, *[idle] * (SLOTS - len(chain))),
            state_at=np.cumsum([0, *map(len, states)]),
            p_at=np.cumsum([0, *(len(a.p) for a in chain)]),
            ends=np.array(ends, dtype=np.int64),
            states=np.concatenate([np.empty(0), *states]),
            p=np.concatenate([np.empty(0), *(a.p for a in chain)]),
            rest=rest,
            compiled=ready,
        )


def _idle(state: FloatArray, value: float, p: FloatArray) -> float:
    return value
