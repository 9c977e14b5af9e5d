"""The numbers of a fit with their 95 % intervals, from the slopes of the whitened error (Gauss and Newton)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..effects import Parameter
from ..record import FloatArray
from ..results import FittedEffect, FittedParameter
from .fit import Fit, Solver, descend, slopes
from .free import Free, free_numbers, get, put
from .linear import linear_values
from .noise import whitener
from .pipeline import Part, as_tuple
from .problem import Problem

NORMAL_95, CHI2_95 = 1.96, 3.84
# profiles cost some fits each; longer lists of numbers keep the intervals of the slopes
MOST_PROFILES, TRIES = 6, 5
# the process is never exactly lag and dead time: no number is known to better than 1 %, however little noise there is
MODEL_ERROR = 0.01
Key = tuple[int, str, int]


def covariance(problem: Problem, fitted: Fit) -> tuple[dict[Key, tuple[float, float]], FloatArray]:
    """Return (value, deviation) of each searched number, and the covariance of the coefficients (columns, columns)."""
    solver = Solver(problem, whitener(fitted.noise, problem.used, problem.interval))
    free = free_numbers(problem, fitted.shape)
    _, rss, rest = solver.rest(fitted.shape)
    others = solver.columns(fitted.shape)
    variance = rss / max(solver.white.samples, 1)
    X = np.column_stack([slopes(solver, fitted.shape, rest, free), others])
    deviations, C = _inverse(X.T @ X, variance)
    values = get(fitted.shape, free)
    m = len(free)
    known = {(f.place, f.name, f.item): (float(values[i]), float(deviations[i])) for i, f in enumerate(free)}
    return known, C[m:, m:]


def _inverse(G: FloatArray, variance: float) -> tuple[FloatArray, FloatArray]:
    """Return the deviations and the covariance that belong to a matrix of inner products."""
    # a number without any slope here gets a huge, but finite, interval
    scale = 1.0 / np.sqrt(np.maximum(np.diag(G), 1e-30))
    A = G * np.outer(scale, scale) + 1e-9 * np.eye(len(G))
    C = np.linalg.inv(A) * np.outer(scale, scale) * variance
    return np.sqrt(np.maximum(np.diag(C), 0.0)), C


def profile(problem: Problem, fitted: Fit, known: Mapping[Key, tuple[float, float]]) -> dict[Key, tuple[float, float]]:
    """Return the 95 % interval of each searched number of the effects: where the deviance has risen by 3.84.

    All other numbers are fitted anew at each end (profile likelihood), because the error is not a parabola: a gap
    that is a little wider closes at other samples.
    """
    solver = Solver(problem, whitener(fitted.noise, problem.used, problem.interval))
    lowest = solver.white.deviance(solver.rss(fitted.shape))
    out: dict[Key, tuple[float, float]] = {}
    for f in free_numbers(problem, fitted.shape):
        key = (f.place, f.name, f.item)
        if f.place >= 0 and not f.nuisance and len(out) < MOST_PROFILES and np.isfinite(known[key][1]):
            value = known[key][0]
            low, high = (_end(solver, fitted, f, known[key], side, lowest) for side in (-1.0, 1.0))
            below, above = (float(np.hypot(end - value, MODEL_ERROR * value)) for end in (low, high))
            out[key] = (max(value - below, f.low), min(value + above, f.high))
    return out


def _end(solver: Solver, fitted: Fit, f: Free, number: tuple[float, float], side: float, lowest: float) -> float:
    value, deviation = number
    reach = NORMAL_95 * deviation
    for _ in range(TRIES):
        end = float(np.clip(value + side * reach, f.low, f.high))
        shape = descend(solver, put(fitted.shape, [f], np.array([end])), rounds=2, hold=f)
        rise = solver.white.deviance(solver.rss(shape)) - lowest
        if abs(rise - CHI2_95) < 0.6 or end in (f.low, f.high):
            break
        reach *= float(np.clip(np.sqrt(CHI2_95 / max(rise, 0.1)), 0.5, 2.0))
    return end


def fitted_effects(
    problem: Problem, fitted: Fit, recorders: tuple[Part, ...] = (), *, careful: bool = False
) -> list[FittedEffect]:
    """Return the effects of a fit, in the order a signal meets them, with values, units and intervals.

    careful: intervals from the profile of the likelihood instead of its slopes.
    """
    known, C = covariance(problem, fitted)
    ends = profile(problem, fitted, known) if careful else {}
    column = 2 + len(problem.holes) + 1
    out = []
    for place, (part, values) in enumerate(zip(fitted.shape.parts, linear_values(problem, fitted), strict=True)):
        solved: dict[str, list[float]] = {}
        if part.is_linear:
            for name in part.effect.fitting.linear:
                for _ in as_tuple(values[name]):
                    turns = 2 if part.effect.fitting.phase else 1
                    own = C[column : column + turns, column : column + turns]
                    solved.setdefault(name, []).append(float(np.sqrt(np.trace(own) / turns)) / abs(fitted.gain))
                    column += turns
        out.append(_effect(part, place, values, known, solved, ends))
    out += [_effect(part, -2, dict(part.values), {}, {}, {}) for part in recorders]
    return out


def _effect(
    part: Part,
    place: int,
    values: Mapping[str, float | tuple[float, ...]],
    known: Mapping[Key, tuple[float, float]],
    solved: Mapping[str, list[float]],
    ends: Mapping[Key, tuple[float, float]],
) -> FittedEffect:
    e = part.effect
    parameters = {}
    for q in e.parameters:
        if q.name not in values or (q.nuisance and q.many and not values[q.name]):
            continue
        numbers = as_tuple(values[q.name])
        deviations = [known.get((place, q.name, i), (0.0, np.nan))[1] for i in range(len(numbers))]
        deviations = solved.get(q.name, deviations)
        intervals = [
            ends.get((place, q.name, i), _interval(q, v, s))
            for i, (v, s) in enumerate(zip(numbers, deviations, strict=True))
        ]
        ci = None if any(i is None for i in intervals) or not intervals else intervals
        parameters[q.name] = FittedParameter(
            value=numbers if q.many else numbers[0],
            unit=q.unit,
            ci95=None if ci is None else (tuple(ci) if q.many else ci[0]),  # type: ignore[arg-type]
            meaning=q.meaning,
            nuisance=q.nuisance,
            level=e.stage == "valve" and q.unit == "span" and not np.isfinite(q.neutral),
        )
    return FittedEffect(e.name, parameters, part.column, e.sentence, e.fitting.meaning, str(e.stage))


def _interval(q: Parameter, value: float, deviation: float) -> tuple[float, float] | None:
    if not np.isfinite(deviation) or not np.isfinite(value):
        return None
    return float(max(value - NORMAL_95 * deviation, q.low)), float(min(value + NORMAL_95 * deviation, q.high))


def process_parameters(problem: Problem, fitted: Fit) -> dict[str, FittedParameter]:
    """Return Kp, tau, theta (where it is part of the model) and offset with their intervals."""
    known, C = covariance(problem, fitted)

    def number(value: float, deviation: float, unit: str, meaning: str) -> FittedParameter:
        wide = NORMAL_95 * deviation
        return FittedParameter(value, unit, (value - wide, value + wide) if np.isfinite(wide) else None, meaning)

    sd = np.sqrt(np.maximum(np.diag(C), 0.0))
    out = {
        "Kp": number(fitted.gain, float(sd[0]), "1", "static gain, PV span per OP span"),
        "tau": number(*known[(-1, "lag", 0)], "s", "time constant"),
        "offset": number(float(fitted.coefficients[1]), float(sd[1]), "PV span", "PV at no output"),
    }
    if problem.delay is not None:
        out["theta"] = number(*known[(-1, "delay", 0)], "s", "dead time of the settings, refined")
    return out
