"""Reasons in words: why an effect was not taken, what to think of a small gap, why a kept model does not hold.

Each possible reason why a kept model does not hold on another record (another operating point, another process, an
effect that is gone) is tried by itself on that record and told only where the error falls with it."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..record import Note
from ..results import Candidate, FittedEffect, Model
from ..words import noted
from .fit import Solver, finished, fit
from .holdout import Tested, better, fitted_problem, tested
from .locate import turning_points
from .pipeline import Part, Shape, moved_output, moved_process
from .problem import Problem, usual_output

HEALTHY = 0.01  # of span: a smaller gap is what a good valve has, by the usual rule of 1 % of travel with a positioner
FEW_SAMPLES, TIMES_NOISE = 5.0, 2.0  # in which OP crosses a gap, by which that moves PV, to call the gap well seen
LOWER = 1.0 - 1.0 / 1.08**2  # of the squared hold-out error, that goes where it is 1.08 times larger without the effect
ABOUT = 0.1  # errors closer than this share say the same
LEAST_MOTION = 3.0  # PV must move by this many times its noise before anything can be said about how it follows OP
SAME_PLACE = 0.5  # share of this record's OP that must lie where OP was when the model was fitted
LITTLE = 0.3  # of OP's travel: where less reaches the stem, next to nothing reaches the process
UNITS = {"span": (100.0, " %"), "OP span": (100.0, " %"), "1/s": (100.0, " % per second")}
SHARES = np.geomspace(0.2, 5.0, 13)  # of the kept time constant, tried beside it; then finer around the best


def usual_move(problem: Problem) -> float:
    """Return by how much OP usually moves from one sample to the next while it moves [span]."""
    moves = np.abs(np.diff(problem.output))
    moves = moves[moves > 1e-9]
    return float(np.median(moves)) if moves.size else 0.0


def marked(problem: Problem, gain: float, effect: FittedEffect) -> FittedEffect:
    """Return an accepted effect, a gap with notes where it is small; gain: of the process [PV span / OP span]."""
    d = effect.gap
    if d is None:
        return effect
    move, times = usual_move(problem), abs(gain) * d / problem.floor
    samples = d / move if move > 0.0 else np.inf
    notes = [(d < HEALTHY, noted("small_gap", {"size": d, "limit": HEALTHY})), (samples < FEW_SAMPLES, noted(
        "coarse_samples", {"samples": samples})), (times < TIMES_NOISE, noted("small_against_noise", {"times": times}))]
    return replace(effect, notes=tuple(note for holds, note in notes if holds))


def too_little(problem: Problem, shape: Shape, gain: float, name: str = "too_little_motion") -> list[Note]:
    """Say so where PV, with that gain, follows OP by too little beside its noise."""
    motion = abs(gain) * float(np.std(moved_process(problem, shape)[problem.used])) / problem.floor
    return [] if motion >= LEAST_MOTION else [noted(name, {"motion": motion})]


def with_reasons(problem: Problem, gain: float, candidates: Sequence[Candidate], accepted: Sequence[str],
                 alike: Sequence[tuple[str, str]], siblings: Mapping[str, Sequence[str]], reason: Note | None,
                 enough: float) -> tuple[Candidate, ...]:
    """Return the candidates, each that was not accepted with the reason.

    gain: of the process. alike: (accepted, other) that the record cannot tell apart. siblings: look-alikes by name.
    reason: why nothing can be told about the loop at all. enough: evidence that an effect must bring."""
    move = usual_move(problem)
    turns = sum(map(len, turning_points(problem.output, max(move, 0.02 * float(np.ptp(problem.output))))))
    finest = max(problem.floor / max(abs(gain), 1e-9), move)

    def why(c: Candidate) -> Note | None:
        if c.effect in accepted:
            return None
        d, by = c.gap, " and ".join(name.replace("_", " ") for name in accepted)
        if taken := [a for a, other in alike if other == c.effect]:
            return noted("look_alike", taken=taken[0].replace("_", " "))
        if taken := [a for a in accepted if c.effect in siblings.get(a, ())]:
            return noted("look_alike_better", taken=taken[0].replace("_", " "))
        if reason is not None:
            return reason
        if d is not None and turns < 2:
            return noted("op_never_turns")
        if _does_nothing(c):
            return noted("fits_nothing")
        if d is not None and d < finest:
            return noted("below_resolution", {"size": d, "resolution": finest})
        if (c.evidence or 0.0) >= enough and accepted:
            return noted("other_explains", by=by, s="s" * (len(accepted) == 1))
        little = (c.evidence or 0.0) < enough and c.error_reduction > LOWER
        return noted("little_evidence" if little else "no_better_prediction")

    return tuple(replace(c, why=why(c)) for c in candidates)


def _does_nothing(c: Candidate) -> bool:
    """True where the sizes of an effect went to nothing: zero, or a limit at infinity."""
    sizes = [p.value for p in c.parameters.values() if not p.nuisance and p.unit not in ("s", "0 or 1")]
    numbers = np.hstack(sizes) if sizes else np.ones(1)
    return bool(np.all(np.isinf(numbers) | (np.abs(numbers) < 1e-5)))


def why_not(problem: Problem, model: Model, shape: Shape, recorders: tuple[Part, ...], plain: Tested, holdout: float,
            error_of: Callable[[Model, Shape], float | None]) -> tuple[Note, ...]:
    """Return the reasons why a kept model predicts a record no better than the plain one fitted to it; () if it does.

    shape: of the model, matched to this record. holdout: its error here. error_of: hold-out error of another model."""
    if holdout < (1.0 - ABOUT) * plain.rmse_holdout:
        return ()
    without = {name: error_of(model.without(name), shape.without(name)) for name in shape.names}
    gone = [noted("effect_not_here", {"effect": name, "rmse_holdout": less}, name=name.replace("_", " "), now=holdout)
            for name, less in without.items() if less is not None and less < (1.0 - ABOUT) * holdout]
    return (*too_little(problem, shape, model.Kp, "too_little_motion:kept"), *_place(problem, model), *gone,
            *_process(problem, model, shape, recorders, plain))


def _place(problem: Problem, model: Model) -> list[Note]:
    here = usual_output(problem)
    if model.output is None or here is None:
        return []
    u, (low, high) = problem.output[problem.used], model.output
    inside = float(np.mean(np.abs(u - 0.5 * (low + high)) <= 0.6 * (high - low)))
    return [] if inside >= SAME_PLACE else [noted("other_operating_point", {"share_inside": inside}, low=100 * low,
                                                  high=high, first=100 * here[0], last=here[1])]


def _process(problem: Problem, model: Model, shape: Shape, recorders: tuple[Part, ...], plain: Tested) -> list[Note]:
    """Whether the effects hold with a gain and a time constant of this record, or else with other numbers of theirs."""
    noise = plain.fit.noise
    solver = Solver(problem, noise)
    seen = fitted_problem(problem, recorders)

    def best(lags: Sequence[float]) -> Shape:
        return min((replace(shape, lag=float(lag)) for lag in lags), key=solver.rss)

    least, most = 0.2 * problem.interval, 0.5 * problem.duration
    near = best(np.clip(model.tau * SHARES, least, most).tolist())
    near = best(np.clip(near.lag * np.geomspace(0.78, 1.28, 9), least, most).tolist())
    process = tested(problem, finished(seen, near, noise), recorders, rounds=0)
    whole = better(problem, fit(seen, near, noise), recorders)
    moved = _changes(shape, whole.fit.shape)
    # more numbers fit better, always: they must do so clearly to be the reason
    if moved and whole.rmse_holdout < (1.0 - ABOUT) * min(process.rmse_holdout, plain.rmse_holdout):
        numbers = ", ".join([*moved, *_of_process(model, whole)])
        travel, stem = (float(np.ptp(np.quantile(x[problem.used], [0.01, 0.99])))
                        for x in (problem.output, moved_output(problem, whole.fit.shape.parts)))
        values = {"rmse_holdout": whole.rmse_holdout, "travel": travel, "stem": stem}
        told = "numbers_changed:still" if stem < LITTLE * travel else "numbers_changed"
        return [noted(told, values, numbers=numbers)]
    changed = _of_process(model, process)
    if not changed or process.rmse_holdout >= (1.0 - ABOUT) * plain.rmse_holdout:
        return []
    names = " and ".join(part.effect.name.replace("_", " ") for part in shape.parts)
    held = f", and {names} as kept" if names else ""
    values = {"Kp": process.fit.gain, "tau": near.lag, "rmse_holdout": process.rmse_holdout}
    return [noted("process_changed", values, changed=" and ".join(changed), held=held)]


def _of_process(model: Model, now: Tested) -> list[str]:
    """Name gain and time constant where they differ from the kept ones."""
    return _told([("gain", now.fit.gain, model.Kp, ""), ("time constant", now.fit.shape.lag, model.tau, " s")])


def _changes(before: Shape, after: Shape) -> list[str]:
    """Name the numbers of effects that differ, in words; signs, starts and events left out."""
    rows = []
    for old, new in zip(before.parts, after.parts, strict=True):
        for q in old.effect.parameters:
            one, other = old.values.get(q.name), new.values.get(q.name)
            if isinstance(one, float) and isinstance(other, float) and not q.nuisance and not old.is_linear:
                scale, unit = UNITS.get(q.unit, (1.0, "" if q.unit == "1" else f" {q.unit}"))
                rows.append((f"{old.effect.name.replace('_', ' ')} {q.name} =", scale * other, scale * one, unit))
    return _told(rows)


def _told(rows: Sequence[tuple[str, float, float, str]]) -> list[str]:
    """Say of each name, number here, kept number and unit how they differ, where it is by more than ABOUT."""
    return [f"{name} {here:.3g}{unit} (kept: {kept:.3g}{unit})" for name, here, kept, unit in rows
            if np.isfinite([here, kept]).all() and abs(here - kept) > ABOUT * abs(kept)]
