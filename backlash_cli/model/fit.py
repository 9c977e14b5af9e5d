"""Fits a shape to one loop: linear numbers by generalised least squares, the others by slopes, noise by likelihood."""

import cmath
from dataclasses import replace

import numpy as np

from ..effects.process import DEAD_TIME
from ..record import FloatArray, Frozen
from .noise import Noise, downhill, fit_noise, known_load, whitener
from .pipeline import Shape, as_tuple, load_regressors, moved_process, predict, regressors, sensed_slopes, through
from .problem import Problem

USUAL_SPAN = 0.5  # a load moves PV by less than this [span]
DELAY_TRUST = 0.2  # the dead time of the settings is trusted to this share: a real one that is missing must lie outside


class Free(Frozen):
    """One searched number: a parameter of the part at `place`; -1 is the process."""

    place: int
    name: str
    low: float
    high: float
    step: float
    nuisance: bool = False


def free_numbers(problem: Problem, shape: Shape) -> list[Free]:
    """Return the searched numbers of a shape; lists stay as proposed, and a parameter at infinity takes no part."""
    h = problem.interval
    out = [Free(-1, "lag", 0.2 * h, 0.5 * problem.duration, 0.01 * shape.lag)]
    if problem.delay is not None and DEAD_TIME.name not in shape.names:
        out.append(Free(-1, "delay", (1 - DELAY_TRUST) * problem.delay, (1 + DELAY_TRUST) * problem.delay, 0.2 * h))
    for place, part in enumerate(shape.parts):
        fitting = part.effect.fitting
        solved = (*fitting.linear, fitting.phase, *fitting.fixed)
        for q in part.effect.parameters:
            value = part.values.get(q.name)
            if q.name in solved or q.choices or not isinstance(value, float | int) or not np.isfinite(value):
                continue
            high, step = q.high, 0.02 if q.nuisance or not value else 0.02 * abs(value)
            if q.unit == "s":
                high, step = min(high, 0.5 * problem.duration), max(1e-4 * abs(value), 0.05 * h)
                if fitting.phase:
                    # over the record another period turns the swing: by a few degrees, no more
                    step = 0.01 * value**2 / problem.duration
            elif q.unit in ("span", "OP span"):
                step = 2e-4
            out.append(Free(place, q.name, q.low, high, step, q.nuisance))
    return out


def get(shape: Shape, free: list[Free]) -> FloatArray:
    """Return the searched numbers of a shape, (numbers,)."""
    return np.array([getattr(shape, f.name) if f.place < 0 else shape.parts[f.place].values[f.name] for f in free],
                    dtype=np.float64)


def put(shape: Shape, free: list[Free], numbers: FloatArray) -> Shape:
    """Return the shape with the searched numbers (numbers,) replaced, each held within its range."""
    for f, number in zip(free, numbers, strict=True):
        value = {f.name: float(min(max(number, f.low), f.high))}
        shape = replace(shape, **value) if f.place < 0 else shape.with_values(f.place, **value)  # type: ignore[arg-type]
    return shape


CLOSE = 0.05  # gain in deviance below which the searched numbers stand
BENT_ROUNDS, COLD_ROUNDS, BENT_ENOUGH = 3, 25, 1e-4  # steps to the linear numbers behind a bent transmitter


class Fit(Frozen, eq=False):
    """A fitted model of one loop. coefficients: gain, offset, forgotten start, and one per linear column. deviance: -2
    log likelihood. rmse: root mean square of measured minus predicted PV."""

    shape: Shape
    coefficients: FloatArray
    noise: Noise
    deviance: float
    rmse: float

    @property
    def gain(self) -> float:
        """Static gain [PV span / OP span]."""
        return float(self.coefficients[0])


class Solver:
    """Solves the linear numbers of many shapes under one noise, remembering the columns that stay the same."""

    def __init__(self, problem: Problem, noise: Noise) -> None:
        self.problem, self.white = problem, whitener(noise, problem.used, problem.interval)
        self._measured = self.white.columns(problem.measurement)
        self._raw: FloatArray | None = None
        self._last: tuple[Shape, tuple[FloatArray, float, FloatArray]] | None = None
        self._bent: FloatArray | None = None

    def solve(self, shape: Shape) -> tuple[FloatArray, float, FloatArray]:
        """Return coefficients, whitened sum of squares and the whitened moved process of a shape."""
        if self._last is None or self._last[0] != shape:
            self._last = shape, self._solve_bent(shape) if shape.sensors else self._solve(shape)
        return self._last[1]

    def _solve(self, shape: Shape) -> tuple[FloatArray, float, FloatArray]:
        raw = load_regressors(self.problem, shape)
        if raw is not self._raw:
            self._take(self.white.columns(raw), self._measured, ridges(self.problem, raw))
            self._raw = raw
        return self._solved(self.white.columns(moved_process(self.problem, shape)))

    def _take(self, others: FloatArray, measured: FloatArray, ridge: FloatArray) -> None:
        """Take whitened columns (samples, columns) and measurement (samples,) as the ones to solve."""
        self._raw, self._others, self._y, self._yy = None, others, measured, float(measured @ measured)
        self._b, self._G = np.append(0.0, others.T @ measured), np.empty((len(ridge) + 1, len(ridge) + 1))
        self._G[1:, 1:] = others.T @ others + np.diag(ridge)

    def _solved(self, x: FloatArray) -> tuple[FloatArray, float, FloatArray]:
        G, b = self._G, self._b
        G[0, 1:] = G[1:, 0] = x @ self._others
        G[0, 0], b[0] = x @ x, x @ self._y
        c = self.inverse(b[:, None])[:, 0]
        return c, max(self._yy - float(c @ (2.0 * b - G @ c)), 1e-300), x

    def _solve_bent(self, shape: Shape) -> tuple[FloatArray, float, FloatArray]:
        """As `solve`, where a transmitter that is not linear shows the sum of the columns: Gauss-Newton steps."""
        problem, white = self.problem, self.white
        raw = regressors(problem, shape)
        ridge, c, rounds = ridges(problem, raw[:, 1:]), self._bent, BENT_ROUNDS
        if c is None or len(c) != raw.shape[1]:
            c = self._solve(replace(shape, parts=tuple(p for p in shape.parts if p not in shape.sensors)))[0]
            rounds = COLD_ROUNDS
        best, found = np.inf, c
        for _ in range(rounds):
            process = raw @ c
            off = white.columns(problem.measurement - through(problem, shape.sensors, process))
            rss = float(off @ off)
            if rss >= best:
                c = 0.5 * (c + found)
                continue
            gained, best, found = best - rss, rss, c
            columns = white.columns(sensed_slopes(problem, shape, process, raw))
            self._take(columns[:, 1:], off + columns @ c, ridge)
            c = self._solved(columns[:, 0])[0]
            if gained < BENT_ENOUGH * best:
                break
        self._bent = found
        return found, max(best, 1e-300), columns[:, 0]

    def inverse(self, B: FloatArray) -> FloatArray:
        """Return (columns, numbers) that the inner products of the shape solved last turn into B."""
        scale = 1.0 / np.sqrt(np.maximum(self._G.diagonal(), 1e-300))[:, None]
        A = self._G * scale * scale.T
        A.flat[:: len(A) + 1] += 1e-10  # a trace of damping, so that a column that does nothing gets the coefficient 0
        return np.asarray(np.linalg.solve(A, scale * B) * scale)

    def columns(self, shape: Shape) -> FloatArray:
        """Return the whitened columns of a shape, the moved process first, (samples, columns)."""
        return np.column_stack([self.solve(shape)[2], self._others])

    def rss(self, shape: Shape) -> float:
        """Return the whitened sum of squares of a shape; NaN, which is not less than any, of one far out of range."""
        with np.errstate(over="ignore", invalid="ignore"):
            return self.solve(shape)[1]

    def rest(self, shape: Shape) -> tuple[FloatArray, float, FloatArray]:
        """Return coefficients, whitened sum of squares and the whitened rest (samples,) of a shape."""
        c, rss, x = self.solve(shape)
        return c, rss, self._y - c[0] * x - self._others @ c[1:]


def ridges(problem: Problem, columns: FloatArray) -> FloatArray:
    """Return what keeps the coefficient of each load regressor, (columns,), from any value where the samples at hand do
    not show it: variance of the noise over that expected of the coefficient."""
    loads = columns[:, 2:]
    sizes = np.sqrt(np.einsum("ij,ij->j", loads, loads) / len(columns))
    return (problem.floor / np.array([1e3, USUAL_SPAN, *USUAL_SPAN / np.maximum(sizes, 1e-12)])) ** 2


def descend(solver: Solver, shape: Shape, *, rounds: int = 8) -> Shape:
    """Refine the searched numbers until the deviance gains next to nothing."""
    if DEAD_TIME.name in shape.names:  # that of the settings stands beside it: only their sum shows
        shape = replace(shape, delay=solver.problem.delay or 0.0)
    free = free_numbers(solver.problem, shape)
    low, high = np.array([(f.low, f.high) for f in free]).T
    x = downhill(get(shape, free), lambda x: solver.rss(put(shape, free, x)),
                 lambda x: curvature(solver, put(shape, free, x)), low, high, solver.white.samples, rounds, CLOSE)
    return put(shape, free, x)


def curvature(solver: Solver, shape: Shape) -> tuple[FloatArray, FloatArray]:
    """Return half the Hessian (numbers, numbers) and gradient (numbers,) of the whitened sum of squares.

    The linear numbers follow the searched ones, but what their following does to the slopes in second order is left
    out (Kaufman, BIT 15, 1975): one column per number instead of a new solution."""
    _, _, rest = solver.rest(shape)
    Z = slopes(solver, shape, free_numbers(solver.problem, shape))
    B = solver.columns(shape).T @ Z
    return Z.T @ Z - B.T @ solver.inverse(B), -Z.T @ rest


def slopes(solver: Solver, shape: Shape, free: list[Free]) -> FloatArray:
    """Return the change of the whitened prediction (samples, numbers) per unit of each number that is not linear."""
    c = solver.solve(shape)[0]
    here = predict(solver.problem, shape, c)
    D = []
    for f, number in zip(free, get(shape, free), strict=True):
        step = f.step if number + f.step <= f.high else -f.step
        D.append((predict(solver.problem, put(shape, [f], np.array([number + step])), c) - here) / step)
    return solver.white.columns(np.column_stack(D))


def fit(problem: Problem, shape: Shape, noise: Noise, *, rounds: int = 3, before: float = np.inf) -> Fit:
    """Fit a shape from start values, whose deviance was `before`: searched numbers and noise in turn."""
    for _ in range(rounds):
        solver = Solver(problem, noise)
        shape = descend(solver, shape)
        noise = refit_noise(solver, shape, noise)
        now = finished(problem, shape, noise)
        if now.deviance > before - 0.5:
            break
        before = now.deviance
    return now


def refit_noise(solver: Solver, shape: Shape, first: Noise) -> Noise:
    """Return the noise of greatest likelihood for the error a shape leaves, searched from `first`."""
    raw = raw_error(solver.problem, shape, solver.solve(shape)[0])
    return fit_noise(raw, solver.problem.used, solver.problem.interval, first)


def finished(problem: Problem, shape: Shape, noise: Noise) -> Fit:
    """Return the fit of a shape whose searched numbers stand."""
    solver = Solver(problem, noise)
    coefficients, rss, _ = solver.solve(shape)
    rmse = rms(raw_error(problem, shape, coefficients)[problem.used])
    return Fit(shape, coefficients, noise, solver.white.deviance(rss), rmse)


def rms(values: FloatArray) -> float:
    """Return the root mean square of values, 0 of none."""
    return float(np.sqrt(values @ values / max(values.size, 1)))


def raw_error(problem: Problem, shape: Shape, coefficients: FloatArray) -> FloatArray:
    """Return measured minus predicted PV (samples,), 0 where nothing was measured."""
    return np.where(problem.used, problem.measurement - predict(problem, shape, coefficients), 0.0)


def predicted_by(seen: Problem, fitted: Fit) -> FloatArray:
    """Return PV predicted by a fit on the whole grid, (samples,), with the load read from the samples that count."""
    return with_load(seen, predict(seen, fitted.shape, fitted.coefficients), fitted.noise)


def with_load(seen: Problem, predicted: FloatArray, noise: Noise | None) -> FloatArray:
    """Return a prediction from OP (samples,), with the load as known some time before where the loop is driven by it;
    noise: of the model; None: fitted to what the prediction misses."""
    if not seen.by_load:
        return predicted
    error, h, span = np.where(seen.used, seen.measurement - predicted, 0.0), seen.interval, seen.duration
    noise = noise or fit_noise(error, seen.used, h, Noise(1.0, 0.03 * span, 0.003 * span))
    return predicted + known_load(error, seen.used, h, noise, seen.ahead)


def linear_values(fitted: Fit) -> list[dict[str, float | tuple[float, ...]]]:
    """Return for each part all its values, those that were solved for included, in the effect's own units."""
    out = []
    solved = iter((fitted.coefficients[3:] / fitted.gain).tolist())
    for part in fitted.shape.parts:
        values, fitting = dict(part.values), part.effect.fitting
        for name in fitting.linear:
            found = [next(solved) for _ in as_tuple(values[name])]
            if fitting.phase:
                turned = complex(found[0], next(solved))
                found, values[fitting.phase] = [abs(turned)], cmath.phase(turned)
            values[name] = tuple(found) if isinstance(values[name], tuple) else found[0]
        out.append(values)
    return out
