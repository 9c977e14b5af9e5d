"""From the controller output to the predicted measurement: effects in their order, dead time, lag, gain, offset."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..effects import EFFECTS, Effect, Stage
from ..effects.fitting import Values
from ..effects.process import late
from ..record import FloatArray
from .problem import Hole, Problem
from .response import delayed_lag, forgotten

ORDER = {stage: i for i, stage in enumerate(Stage)}
# a load moves PV by less than this [span]
USUAL_SPAN = 0.5
MOST_REMEMBERED, FEW_REMEMBERED = 60, 16
# move of PV [span] by which the slopes of a transmitter are taken
SMALL_MOVE = 1e-4
PLACE = {effect.name: i for i, effect in enumerate(EFFECTS)}


@dataclass(frozen=True)
class Part:
    """One effect in a model, with the values of its parameters and, where it needs one, its measured column."""

    effect: Effect
    values: Values
    column: str = ""

    def with_values(self, **values: float | tuple[float, ...]) -> Part:
        """Return the part with some values replaced."""
        return replace(self, values={**self.values, **values})

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
        parts = list(self.parts)
        parts[place] = parts[place].with_values(**values)
        return replace(self, parts=tuple(parts))

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
    key = tuple([(part.effect.name, part.column, *part.values.items()) for part in movers])
    if key not in problem.moved:
        signal = problem.output
        for part in movers:
            signal = after(problem, part, signal)
        while len(problem.moved) >= FEW_REMEMBERED:
            del problem.moved[next(iter(problem.moved))]
        problem.moved[key] = signal
    return problem.moved[key]


def packed(part: Part) -> FloatArray:
    """Return the parameter array of a part; without the checks of `Effect.pack`, as a fit stays within the bounds."""
    parameters = part.effect.parameters
    if any(q.many for q in parameters):
        return part.effect.pack(part.values)
    return np.array([part.values.get(q.name, q.neutral) for q in parameters], dtype=np.float64)


def after(problem: Problem, part: Part, signal: FloatArray) -> FloatArray:
    """Return the signal (samples,) after one effect."""
    p = packed(part)
    if part.effect.fitting.whole is not None:
        return part.effect.fitting.whole(signal, p, problem.interval)
    series: FloatArray | tuple[float, ...] = problem.columns[part.column] if part.column else ()
    return part.effect.apply(signal, p, problem.interval, series=series)


def load_columns(problem: Problem, part: Part) -> list[FloatArray]:
    """Return what a linear effect adds to the process input per unit of each linear value, one (samples,) each."""
    effect, fitting = part.effect, part.effect.fitting
    key = (effect.name, part.column, *((k, v) for k, v in part.values.items() if k not in fitting.linear), *(
        (k, len(as_tuple(part.values[k]))) for k in fitting.linear))
    if key in problem.memory:
        return problem.memory[key]
    if len(problem.memory) > MOST_REMEMBERED:
        problem.memory.clear()
    series: FloatArray | tuple[float, ...] = problem.columns[part.column] if part.column else ()
    many = {q.name: q.many for q in effect.parameters}
    sizes = {n: len(as_tuple(part.values.get(n, ()))) for n in fitting.linear}
    none = {n: (0.0,) * size if many[n] else 0.0 for n, size in sizes.items()}
    rest = {k: v for k, v in part.values.items() if k not in fitting.linear}
    turns: list[dict[str, float]] = [{fitting.phase: 0.0}, {fitting.phase: 0.5 * np.pi}] if fitting.phase else [{}]
    out = []
    for name, size in sizes.items():
        for i in range(size if many[name] else 1):
            unit = tuple(float(j == i) for j in range(size)) if many[name] else 1.0
            for turn in turns:
                p = effect.pack({**rest, **none, name: unit, **turn})
                out.append(effect.apply(np.zeros(problem.samples), p, problem.interval, series=series))
    problem.memory[key] = out
    return out


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


def sensed(problem: Problem, shape: Shape, process: FloatArray) -> FloatArray:
    """Return what the transmitter shows of the process's own value (samples,)."""
    return through(problem, shape.sensors, process)


def sensed_slopes(problem: Problem, shape: Shape, process: FloatArray, columns: FloatArray) -> FloatArray:
    """Return how what the transmitter shows changes per unit of each column (samples, columns) added to `process`."""
    if not shape.sensors:
        return columns
    here = sensed(problem, shape, process)
    steps = SMALL_MOVE / np.maximum(np.sqrt(np.mean(columns**2, axis=0)), 1e-12)
    return np.column_stack(
        [(sensed(problem, shape, process + e * x) - here) / e for e, x in zip(steps, columns.T, strict=True)])


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
    key = (shape.lag, delay, *[(p.effect.name, p.column, tuple(p.values.items())) for p in own])
    if problem.others.get("key") != key:
        h, n, tau = problem.interval, problem.samples, shape.lag
        process = [part for part in own if part.on_output]
        lags = [part for part in process if part.effect.fitting.on_loads]
        columns = [np.ones(n), forgotten(n, h, tau)]
        for hole in problem.holes:
            columns.append(delayed_lag(through(problem, process, pulse(problem, hole)), h, tau, delay))
        for part in own:
            if part.is_linear:
                columns += [delayed_lag(through(problem, lags, c), h, tau, 0.0) for c in load_columns(problem, part)]
        columns += [delayed_lag(after(problem, lag, kick(problem, tau)), h, tau, 0.0) for lag in lags]
        problem.others.update(key=key, columns=np.column_stack(columns))
    found: FloatArray = problem.others["columns"]
    return found


def through(problem: Problem, parts: Sequence[Part], signal: FloatArray) -> FloatArray:
    """Return the signal (samples,) after some effects."""
    for part in parts:
        signal = after(problem, part, signal)
    return signal


def pulse(problem: Problem, hole: Hole) -> FloatArray:
    """Return 1 within a hole of OP and 0 elsewhere, (samples,)."""
    out = np.zeros(problem.samples)
    out[hole.first : hole.last] = 1.0
    return out


def kick(problem: Problem, lag: float) -> FloatArray:
    """Return a push of about one time constant at the start, (samples,): what a further lag has to forget."""
    out = np.zeros(problem.samples)
    out[1 : 1 + max(int(lag / problem.interval), 1)] = 1.0
    return out


def predict(problem: Problem, shape: Shape, coefficients: FloatArray) -> FloatArray:
    """Return predicted PV (samples,): `regressors` times coefficients as the transmitter shows them."""
    others = load_regressors(problem, shape) @ coefficients[1:]
    return sensed(problem, shape, coefficients[0] * moved_process(problem, shape) + others)


def spreads(problem: Problem, columns: FloatArray) -> FloatArray:
    """Return how large the coefficient of each load regressor may be expected to be, (columns,), as a deviation.

    Without it a column that the samples at hand do not show, such as the end of a hole, could take any value.
    """
    size = np.sqrt(np.einsum("ij,ij->j", columns, columns) / len(columns))
    out = USUAL_SPAN / np.maximum(size, 1e-12)
    out[0] = 1e3
    out[1] = USUAL_SPAN
    for i, hole in enumerate(problem.holes):
        out[2 + i] = hole.doubt
    return out


def regressors(problem: Problem, shape: Shape) -> FloatArray:
    """Return all columns whose sum predicts PV, (samples, columns): moved process, then the others."""
    return np.column_stack([moved_process(problem, shape), load_regressors(problem, shape)])
