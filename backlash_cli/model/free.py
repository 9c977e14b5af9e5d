"""Which numbers of a shape are searched, in what range, and how far to move one to see a difference."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..effects import Parameter
from .pipeline import Shape, as_tuple
from .problem import Problem

# the dead time of the settings is trusted to this share: a real one that is missing must lie outside
DELAY_TRUST = 0.2


@dataclass(frozen=True)
class Free:
    """One searched number: a parameter (and its item, when it is a list) of the part at `place`; -1 is the process."""

    place: int
    name: str
    item: int
    low: float
    high: float
    step: float
    nuisance: bool = False


def free_numbers(problem: Problem, shape: Shape) -> list[Free]:
    """Return the searched numbers of a shape; a parameter at infinity takes no part."""
    h = problem.interval
    out = [Free(-1, "lag", 0, 0.2 * h, 0.5 * problem.duration, 0.01 * shape.lag)]
    if problem.delay is not None:
        low, high = (1.0 - DELAY_TRUST) * problem.delay, (1.0 + DELAY_TRUST) * problem.delay
        out.append(Free(-1, "delay", 0, low, high, 0.2 * h))
    for place, part in enumerate(shape.parts):
        fitting = part.effect.fitting
        solved = {*fitting.linear, fitting.phase, *fitting.fixed}
        for q in part.effect.parameters:
            if q.name in solved or q.choices or q.name not in part.values:
                continue
            for item, value in enumerate(as_tuple(part.values[q.name])):
                if np.isfinite(value):
                    low, high = _range(q, shape, problem)
                    out.append(Free(place, q.name, item, low, high, _move(q, value, shape, h), q.nuisance))
    return out


def _range(q: Parameter, shape: Shape, problem: Problem) -> tuple[float, float]:
    longest = 0.5 * problem.duration
    return q.low, min(q.high, longest) if q.unit == "s" else q.high


def _move(q: Parameter, value: float, shape: Shape, h: float) -> float:
    if q.unit == "s":
        return max(1e-4 * abs(value), 0.05 * h)
    if q.unit in ("span", "OP span"):
        return 2e-4
    return 0.02 if q.nuisance or not value else 0.02 * abs(value)


def get(shape: Shape, free: list[Free]) -> np.ndarray:
    """Return the searched numbers of a shape, (numbers,)."""
    values = []
    for f in free:
        if f.place < 0:
            values.append(shape.lag if f.name == "lag" else shape.delay)
        else:
            values.append(as_tuple(shape.parts[f.place].values[f.name])[f.item])
    return np.array(values, dtype=np.float64)


def put(shape: Shape, free: list[Free], numbers: np.ndarray) -> Shape:
    """Return the shape with the searched numbers (numbers,) replaced, each held within its range."""
    parts = list(shape.parts)
    lag, delay = shape.lag, shape.delay
    for f, number in zip(free, numbers, strict=True):
        value = float(min(max(number, f.low), f.high))
        if f.place < 0:
            lag, delay = (value, delay) if f.name == "lag" else (lag, value)
            continue
        old = parts[f.place].values[f.name]
        if isinstance(old, tuple):
            parts[f.place] = parts[f.place].with_values(**{f.name: (*old[: f.item], value, *old[f.item + 1 :])})
        else:
            parts[f.place] = parts[f.place].with_values(**{f.name: value})
    return replace(shape, lag=lag, delay=delay, parts=tuple(parts))
