"""From the controller output to the predicted measurement: effects in their order, dead time, lag, gain, offset."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, Self

import numpy as np

from ..effects import EFFECTS, Effect, Stage
from ..effects.fitting import Values
from ..effects.process import delayed_lag, forgotten, late
from ..record import FloatArray, Frozen
from .problem import Problem

STAGES, NAMES = list(Stage), [effect.name for effect in EFFECTS]
SMALL_MOVE = 1e-4  # move of PV [span] by which the slopes of a transmitter are taken
MOST_KEPT = 16  # columns of shapes, which neighbouring trials of a fit share


class Part(Frozen):
    """One effect in a model, with the values of its parameters and, where it needs one, its measured column."""

    effect: Effect
    values: Values
    column: str = ""

    @property
    def is_linear(self) -> bool:
        """True when the effect adds to the process input in proportion to some of its parameters."""
        return bool(self.effect.fitting.linear)

    @property
    def is_recorder(self) -> bool:
        """True when the effect belongs to the recorder and does not move the prediction."""
        return self.effect.fitting.bounds is not None


class Shape(Frozen):
    """The part of a model that is searched: time constant and dead time [s] of the process, and its effects."""

    lag: float
    delay: float
    parts: tuple[Part, ...] = ()

    def with_part(self, part: Part) -> Self:
        """Return the shape with one more effect, at the place where the signal meets it."""
        return replace(self, parts=in_order((*self.parts, part)))

    def without(self, name: str) -> Self:
        """Return the shape without the effect called `name`."""
        return replace(self, parts=tuple(p for p in self.parts if p.effect.name != name))

    def with_values(self, place: int, **values: float | tuple[float, ...]) -> Self:
        """Return the shape with values of the part at `place` replaced."""
        part = self.parts[place]
        part = replace(part, values={**part.values, **values})
        return replace(self, parts=(*self.parts[:place], part, *self.parts[place + 1 :]))

    @property
    def sensors(self) -> list[Part]:
        """The effects of the transmitter: they act on PV after the process and all loads."""
        return acting(self.parts, Stage.SENSOR)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the effects, in the order a signal meets them."""
        return tuple(p.effect.name for p in self.parts)


def acting(parts: Sequence[Part], *stages: Stage) -> list[Part]:
    """Return the parts of these stages that act on a signal: not what is solved for, nor what the recorder does."""
    return [p for p in parts if p.effect.stage in stages and not p.is_linear and not p.is_recorder]


def in_order(parts: Sequence[Part]) -> tuple[Part, ...]:
    """Return the parts in the order a signal meets them; effects from outside come last within their stage."""
    names = [*NAMES, *(part.effect.name for part in parts)]
    return tuple(sorted(parts, key=lambda p: (STAGES.index(p.effect.stage), names.index(p.effect.name))))


def moved_output(problem: Problem, parts: Sequence[Part]) -> FloatArray:
    """Return the output (samples,) after all effects between the controller and the process that are not linear."""
    acts = acting(parts, Stage.COMMAND, Stage.VALVE, Stage.PROCESS)
    out: FloatArray = kept(problem, ("OP", *map(made_of, acts)), lambda: through(problem, acts, problem.output))
    return out


def through(problem: Problem, parts: Sequence[Part], signal: FloatArray) -> FloatArray:
    """Return the signal (samples,) after some effects."""
    for part in parts:
        effect, values = part.effect, part.values
        # without the checks of `Effect.pack`: start values may lie beyond the bounds, to which a fit then holds them
        p = effect.pack(values) if any(q.many for q in effect.parameters) else np.array(
            [values.get(q.name, q.neutral) for q in effect.parameters], dtype=np.float64)
        if effect.fitting.whole is not None:
            signal = effect.fitting.whole(signal, p, problem.interval)
        else:
            signal = effect.apply(signal, p, problem.interval, series=problem.columns.get(part.column, ()))
    return signal


def load_columns(problem: Problem, part: Part) -> list[FloatArray]:
    """Return what a linear effect adds to the process input per unit of each linear value, one (samples,) each; two for
    a swing whose phase is not known: in phase, and a quarter of a period before."""
    effect, fitting = part.effect, part.effect.fitting
    none = {name: tuple(0.0 for _ in as_tuple(part.values[name])) for name in fitting.linear}
    units: list[Values] = [{**none, name: (*zeros[:i], 1.0, *zeros[i + 1 :])} for name, zeros in none.items()
                           for i in range(len(zeros))]
    if fitting.phase:
        units = [{**unit, fitting.phase: turn} for unit in units for turn in (0.0, 0.5 * np.pi)]
    return [effect.apply(np.zeros(problem.samples), effect.pack({**part.values, **unit}), problem.interval,
                         series=problem.columns.get(part.column, ())) for unit in units]


def as_tuple(value: object) -> tuple[float, ...]:
    """Return one number or several as a tuple."""
    return tuple(value) if isinstance(value, tuple | list) else (float(value),)  # type: ignore[arg-type]


def into_process(problem: Problem, shape: Shape) -> tuple[FloatArray, float]:
    """Return what enters the first lag of the process per unit of gain (samples,), and by how much it is delayed [s]:
    not at all where an effect on the load, which acts on what has passed the dead time, is not linear."""
    moved = moved_output(problem, shape.parts)
    if not (loads := acting(shape.parts, Stage.LOAD)):
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


def load_regressors(problem: Problem, shape: Shape) -> FloatArray:
    """Return the other columns of the prediction, (samples, columns): 1, the forgotten start, loads in the order of the
    parts, and for each further lag of the process what it has to forget of its start."""
    lags = [part for part in shape.parts if part.effect.fitting.on_loads]
    loads = [part for part in shape.parts if part.is_linear]
    h, n, tau = problem.interval, problem.samples, shape.lag

    def columns() -> FloatArray:
        kick = np.zeros(n)  # what a further lag has to forget is a push of about one time constant at the start
        kick[1 : 1 + max(int(tau / h), 1)] = 1.0
        pushes = [through(problem, lags, column) for part in loads for column in kept(
            problem, made_of(part), partial(load_columns, problem, part))]
        pushes += [through(problem, [lag], kick) for lag in lags]
        return np.column_stack([np.ones(n), forgotten(n, h, tau), *(delayed_lag(push, h, tau, 0.0) for push in pushes)])

    out: FloatArray = kept(problem, (tau, *map(made_of, (*lags, *loads))), columns)
    return out


def made_of(part: Part) -> tuple[object, ...]:
    """Return all that the columns of a part depend on."""
    return part.effect.name, part.column, *part.values.items()


def kept(problem: Problem, key: object, make: Callable[[], Any]) -> Any:
    """Return what was made of `key` a short while ago, else make it."""
    others = problem.others
    if key not in others:
        while len(others) >= MOST_KEPT:
            del others[next(iter(others))]
        others[key] = make()
    return others[key]


def regressors(problem: Problem, shape: Shape) -> FloatArray:
    """Return all columns whose sum predicts PV, (samples, columns): moved process, then the others."""
    return np.column_stack([moved_process(problem, shape), load_regressors(problem, shape)])


def predict(problem: Problem, shape: Shape, coefficients: FloatArray) -> FloatArray:
    """Return predicted PV (samples,): `regressors` times coefficients as the transmitter shows them."""
    others = load_regressors(problem, shape) @ coefficients[1:]
    return through(problem, shape.sensors, coefficients[0] * moved_process(problem, shape) + others)
