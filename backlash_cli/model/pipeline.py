"""From the controller output to the predicted measurement: effects in their order, dead time, lag, gain, offset."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..effects import EFFECTS, Effect, Stage
from ..effects.fitting import Values
from ..effects.process import delayed_lag, forgotten, late
from ..record import FloatArray
from .problem import Problem

ORDER = {stage: i for i, stage in enumerate(Stage)}
PLACE = {effect.name: i for i, effect in enumerate(EFFECTS)}
# a load moves PV by less than this [span]
USUAL_SPAN = 0.5
# move of PV [span] by which the slopes of a transmitter are taken
SMALL_MOVE = 1e-4


@dataclass(frozen=True)
class Part:
    """One effect in a model, with the values of its parameters and, where it needs one, its measured column."""

    effect: Effect
    values: Values
    column: str = ""

    @property
    def key(self) -> tuple[Any, ...]:
        """What tells the part from another."""
        return (self.effect.name, self.column, *self.values.items())

    @property
    def is_linear(self) -> bool:
        """True when the effect adds to the process input in proportion to some of its parameters."""
        return bool(self.effect.fitting.linear)

    @property
    def is_recorder(self) -> bool:
        """True when the effect belongs to the recorder and does not move the prediction."""
        return self.effect.fitting.bounds is not None

    @property
    def on_output(self) -> bool:
        """True for an effect between the controller and the process that is not linear."""
        return not self.is_linear and self.effect.stage in (Stage.COMMAND, Stage.VALVE, Stage.PROCESS)

    @property
    def on_load(self) -> bool:
        """True for an effect that acts where loads meet the process, after the dead time, and is not linear."""
        return not self.is_linear and self.effect.stage == Stage.LOAD

    @property
    def on_sensor(self) -> bool:
        """True for an effect of the transmitter: it acts on PV after the process and all loads."""
        return self.effect.stage == Stage.SENSOR and not self.is_recorder


@dataclass(frozen=True)
class Shape:
    """The part of a model that is searched: time constant and dead time [s] of the process, and its effects."""

    lag: float
    delay: float
    parts: tuple[Part, ...] = ()

    def with_part(self, part: Part) -> Shape:
        """Return the shape with one more effect, at the place where the signal meets it."""
        return replace(self, parts=in_order((*self.parts, part)))

    def without(self, name: str) -> Shape:
        """Return the shape without the effect called `name`."""
        return replace(self, parts=tuple(p for p in self.parts if p.effect.name != name))

    def with_values(self, place: int, **values: float | tuple[float, ...]) -> Shape:
        """Return the shape with values of the part at `place` replaced."""
        part = self.parts[place]
        part = replace(part, values={**part.values, **values})
        return replace(self, parts=(*self.parts[:place], part, *self.parts[place + 1 :]))

    @property
    def sensors(self) -> tuple[Part, ...]:
        """The effects of the transmitter."""
        return tuple(p for p in self.parts if p.on_sensor)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the effects, in the order a signal meets them."""
        return tuple(p.effect.name for p in self.parts)


def in_order(parts: Sequence[Part]) -> tuple[Part, ...]:
    """Return the parts in the order a signal meets them; effects from outside come last within their stage."""
    return tuple(sorted(parts, key=lambda p: (ORDER[p.effect.stage], PLACE.get(p.effect.name, len(PLACE)))))


def moved_output(problem: Problem, parts: Sequence[Part]) -> FloatArray:
    """Return the output (samples,) after all effects between the controller and the process that are not linear."""
    movers = [part for part in parts if part.on_output]
    if not movers:
        return problem.output
    # most trials of a fit change the process or the loads only
    key = tuple(part.key for part in movers)
    moved: FloatArray = problem.memory.of(key, lambda: through(problem, movers, problem.output))
    return moved


def through(problem: Problem, parts: Sequence[Part], signal: FloatArray) -> FloatArray:
    """Return the signal (samples,) after some effects."""
    for part in parts:
        effect, values = part.effect, part.values
        # without the checks of `Effect.pack`, as a fit stays within the bounds
        p = effect.pack(values) if any(q.many for q in effect.parameters) else np.array(
            [values.get(q.name, q.neutral) for q in effect.parameters], dtype=np.float64)
        if effect.fitting.whole is not None:
            signal = effect.fitting.whole(signal, p, problem.interval)
        else:
            signal = effect.apply(signal, p, problem.interval, series=problem.columns.get(part.column, ()))
    return signal


def load_columns(problem: Problem, part: Part) -> list[FloatArray]:
    """Return what a linear effect adds to the process input per unit of each linear value, one (samples,) each.

    A swing whose phase is not known takes two columns for each value: in phase, and a quarter of a period before.
    """
    effect, fitting = part.effect, part.effect.fitting
    none = {name: tuple(0.0 for _ in as_tuple(part.values[name])) for name in fitting.linear}

    def make() -> list[FloatArray]:
        out = []
        for name, zeros in none.items():
            for i in range(len(zeros)):
                for turn in (0.0, 0.5 * np.pi) if fitting.phase else (0.0,):
                    units = {**none, name: (*zeros[:i], 1.0, *zeros[i + 1 :])}
                    p = effect.pack({**part.values, **units, **({fitting.phase: turn} if fitting.phase else {})})
                    out.append(effect.apply(np.zeros(problem.samples), p, problem.interval,
                                            series=problem.columns.get(part.column, ())))
        return out

    key = (effect.name, part.column, *((k, v if k not in none else len(none[k])) for k, v in part.values.items()))
    columns: list[FloatArray] = problem.memory.of(key, make)
    return columns


def as_tuple(value: object) -> tuple[float, ...]:
    """Return one number or several as a tuple."""
    return tuple(value) if isinstance(value, tuple | list) else (float(value),)  # type: ignore[arg-type]


def into_process(problem: Problem, shape: Shape) -> tuple[FloatArray, float]:
    """Return what enters the first lag of the process per unit of gain (samples,), and by how much it is delayed [s].

    An effect on the load that is not linear acts on what has passed the dead time, so that none is left then.
    """
    moved = moved_output(problem, shape.parts)
    loads = [part for part in shape.parts if part.on_load]
    if not loads:
        return moved, shape.delay
    return through(problem, loads, late(moved, shape.delay / problem.interval)), 0.0


def moved_process(problem: Problem, shape: Shape) -> FloatArray:
    """Return how the process follows the moved output, per unit of gain, (samples,)."""
    moved, delay = into_process(problem, shape)
    return delayed_lag(moved, problem.interval, shape.lag, delay)


def sensed_slopes(problem: Problem, shape: Shape, process: FloatArray, columns: FloatArray) -> FloatArray:
    """Return how what the transmitter shows changes per unit of each column (samples, columns) added to `process`."""
    if not shape.sensors:
        return columns
    here = through(problem, shape.sensors, process)
    steps = SMALL_MOVE / np.maximum(np.sqrt(np.mean(columns**2, axis=0)), 1e-12)
    return np.column_stack([(through(problem, shape.sensors, process + e * x) - here) / e
                            for e, x in zip(steps, columns.T, strict=True)])


def beside_output(problem: Problem, shape: Shape) -> list[Part]:
    """Return the effects that change other columns of the prediction than the moved output."""
    return [part for part in shape.parts if part.is_linear or (part.on_output and part.effect.stage == Stage.PROCESS
            and (problem.holes or part.effect.fitting.on_loads))]  # fmt: skip


def load_regressors(problem: Problem, shape: Shape) -> FloatArray:
    """Return the other columns of the prediction, (samples, columns): 1, the forgotten start, holes, and loads.

    The first 2 + holes columns are the same for every shape; load columns follow in the order of the parts, and
    last, for each further lag of the process, what it has to forget of its start.
    """
    own = beside_output(problem, shape)
    delay = shape.delay if problem.holes else 0.0

    def make() -> FloatArray:
        h, n, tau = problem.interval, problem.samples, shape.lag
        process = [part for part in own if part.on_output]
        lags = [part for part in process if part.effect.fitting.on_loads]
        columns = [np.ones(n), forgotten(n, h, tau)]
        for hole in problem.holes:
            columns.append(delayed_lag(through(problem, process, pulse(n, hole.first, hole.last)), h, tau, delay))
        for part in own:
            if part.is_linear:
                columns += [delayed_lag(through(problem, lags, c), h, tau, 0.0) for c in load_columns(problem, part)]
        # what a further lag has to forget is a push of about one time constant at the start
        kick = pulse(n, 1, 1 + max(int(tau / h), 1))
        columns += [delayed_lag(through(problem, [lag], kick), h, tau, 0.0) for lag in lags]
        return np.column_stack(columns)

    found: FloatArray = problem.others.of((shape.lag, delay, *(part.key for part in own)), make)
    return found


def pulse(samples: int, first: int, last: int) -> FloatArray:
    """Return 1 from `first` to before `last` and 0 elsewhere, (samples,)."""
    out = np.zeros(samples)
    out[first:last] = 1.0
    return out


def regressors(problem: Problem, shape: Shape) -> FloatArray:
    """Return all columns whose sum predicts PV, (samples, columns): moved process, then the others."""
    return np.column_stack([moved_process(problem, shape), load_regressors(problem, shape)])


def predict(problem: Problem, shape: Shape, coefficients: FloatArray) -> FloatArray:
    """Return predicted PV (samples,): `regressors` times coefficients as the transmitter shows them."""
    others = load_regressors(problem, shape) @ coefficients[1:]
    return through(problem, shape.sensors, coefficients[0] * moved_process(problem, shape) + others)


def ridges(problem: Problem, columns: FloatArray) -> FloatArray:
    """Return what keeps the coefficient of each load regressor, (columns,), from any value where the samples at hand do
    not show it, as at the end of a hole: variance of the noise over that expected of the coefficient."""
    loads = columns[:, 2 + len(problem.holes) :]
    sizes = np.sqrt(np.einsum("ij,ij->j", loads, loads) / len(columns))
    spreads = [1e3, USUAL_SPAN, *(hole.doubt for hole in problem.holes), *USUAL_SPAN / np.maximum(sizes, 1e-12)]
    return (problem.floor / np.array(spreads)) ** 2
