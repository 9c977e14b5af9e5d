"""Finds the physical effects that a loop's model lacks, adds them one by one, and says how far the error falls."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..effects import Effect, Stage
from ..effects.registry import all_effects, load_effect
from ..errors import UsageError
from ..record import Record
from ..results import Candidate, Explanation, Fitness, Model, Rest, Step
from .candidates import ENOUGH, Judge, candidate, recorders
from .compare import notes, series_of, unexplained
from .fit import Fit, fit, predicted_by
from .holdout import Tested, better, distance, fitted_problem, only_reports, recorded_floor, tested, through_rounding
from .intervals import fitted_effects, process_parameters
from .locate import regions
from .pipeline import Part
from .problem import Problem, problem_from_record, readings
from .reasons import marked, too_little, with_reasons
from .saved_model import in_ranges_of, kept_model, shape_of
from .search import WEAK, Found, baseline, families, search

Looked = tuple[Problem, Fit, Found, tuple[Part, ...], Sequence[str]]


def explain(record: Record, model: Model | None = None, *, add: Sequence[Effect | str] = (),
            effects: Sequence[Effect | str] = (), seed: int = 0) -> Explanation:
    """Return which physical effects are missing in the model of a loop, with numbers, intervals and the ladder.

    model: go on from this model; its effects stay and are refitted. add: effects to add instead of a search.
    effects: further effects to try beside the project's own. seed: of the random trials; same seed, same answer.
    Raises LoopError when there is nothing to fit, UsageError for an effect that cannot be fitted."""
    record = record if model is None else in_ranges_of(record, model)
    problem, *between = readings(problem_from_record(record, seed))
    more, chosen = ([load_effect(e) if isinstance(e, str) else e for e in several] for several in (effects, add))
    known = {effect.name: effect for effect in (*all_effects(), *more, *chosen)}
    for effect in chosen:
        if not effect.fitted or (effect.column and not problem.columns):
            why = "needs a measured column, and this record has none" if effect.fitted else "cannot be fitted"
            remedy = "backlash effects lists what can be added"
            raise UsageError(f"{effect.name} {why}", where=record.loop, remedy=remedy)
    best = looked(problem, model, known, chosen)
    # rounding blurs how large an effect of the valve is and of which kind, it does not make one: OP is taken as
    # recorded, unless PV says clearly that the valve got what OP was before it was rounded
    if between and (of_valve := valve_effects(best[2].final)):
        other = looked(between[0], model, known, chosen)
        before, after = (found.judge.score(found.final) for _, _, found, *_ in (best, other))
        if of_valve == valve_effects(other[2].final) and after < before - ENOUGH:
            best = other
    return assemble(record, best, model)


def valve_effects(fitted: Fit) -> list[str]:
    """Return which effects of the valve a model has, look-alikes under one name."""
    return families([p for p in fitted.shape.parts if p.effect.stage == Stage.VALVE])


def looked(problem: Problem, model: Model | None, known: Mapping[str, Effect], chosen: Sequence[Effect]) -> Looked:
    """Return what a search comes to on one reading of the record: with the plain model, what was found, the effects of
    the recorder, and the names that the user gave."""
    base = baseline(problem)
    given, held = (None, ()) if model is None else shape_of(model, problem)
    held = held or tuple(recorders(problem, base, [e for e in known.values() if not chosen or e in chosen]))
    problem = replace(problem, floor=recorded_floor(problem, held, base))
    seen = fitted_problem(problem, held)
    if held:
        base = baseline(seen)
    start = base if given is None else fit(seen, replace(given, delay=base.shape.delay), base.noise)
    by_user = [*start.shape.names]
    judge = Judge(seen, base.shape.lag)
    for effect in chosen:
        if effect.fitting.bounds is None and effect.name not in start.shape.names:
            start = candidate(judge, start, effect, must=True) or start
            by_user.append(effect.name)
    tries = [e for e in known.values() if not (e.fitting.seldom and only_reports(problem, held))]
    found = search(seen, () if chosen else tries, start)
    found = replace(found, final=through_rounding(seen, held, found.final))
    return problem, base, found, held, by_user


def assemble(record: Record, best: Looked, model: Model | None) -> Explanation:
    """Put together all that is reported about a search."""
    problem, base, found, held, by_user = best
    seen, gain = found.judge.problem, found.final.gain
    # a valve that sticks hides how PV follows OP, so motion is asked for only when nothing was found
    reasons = () if found.final.shape.parts else tuple(too_little(seen, base.shape, base.gain))
    reason = reasons[0] if reasons else None
    order = [n for n in by_user if n in found.final.shape.names]
    order += sorted((n for n in found.final.shape.names if n not in order), key=lambda n: -found.gain(n))
    ladder = rungs(problem, seen, base, found.final, held, order)
    plain, last = ladder[0][1], ladder[-1][1]
    steps = [Step(name, t.rmse_holdout, t.rmse, predicted_by(problem, t.fit), "user" if name in by_user else "search")
             for name, t in ladder]
    fitted = {e.effect: e for e in fitted_effects(seen, last.fit, held)}
    names = [*(p.effect.name for p in held), *order]
    alikes = (*((p.effect.name, other) for p in held for other in p.effect.fitting.siblings), *found.alike())
    sure = confidence(found, held, by_user, alikes, only_reports(problem, held))
    siblings = {part.effect.name: part.effect.fitting.siblings for part in found.final.shape.parts}
    candidates = with_reasons(problem, gain, tried(seen, found, plain, names), names, alikes, siblings, reason, ENOUGH)
    before = distance(problem, (), predicted_by(problem, plain.fit))
    error = distance(problem, held, predicted_by(problem, last.fit))
    return Explanation(loop=record.loop, noise_floor=problem.floor, candidates=candidates, steps=tuple(steps),
        baseline=Fitness(plain.rmse, plain.rmse_holdout, process_parameters(seen, plain.fit)),
        effects=tuple(marked(problem, gain, replace(fitted[n], confidence=sure[n])) for n in names),
        adequate=found.adequate, rest=Rest(last.rmse_holdout / problem.floor, found.left.goes_with),
        missing_effect=names[0] if names else None,
        where=regions(problem, error, last.fit.shape), where_before=regions(problem, before, plain.fit.shape),
        unexplained=unexplained(last.rmse_holdout, plain.rmse_holdout, problem.floor), look_alikes=alikes,
        margin=margin(found), verdict=reason.message if reason else "", reasons=reasons,
        warnings=notes(problem, record, model),
        series=series_of(problem, predicted_by(problem, last.fit), last.fit.shape), settings=record.settings,
        final=Fitness(last.rmse, last.rmse_holdout, process_parameters(seen, last.fit)),
        model=kept_model(record, seen, last.fit, held, last.rmse_holdout),
        details={"gains": {name: found.gain(name) for name in found.without},
                 "left": {"score": found.left.score, "share": found.left.share},
                 "noise": {"ratio": last.fit.noise.ratio, "slow": last.fit.noise.slow, "fast": last.fit.noise.fast}})


def rungs(problem: Problem, seen: Problem, base: Fit, final: Fit, held: tuple[Part, ...], order: Sequence[str]
          ) -> list[tuple[str | None, Tested]]:
    """Return the models of the ladder with their errors: the plain one, then recorders, then effects in `order`."""
    out: list[tuple[str | None, Tested]] = [(None, better(problem, base))]
    out += [(part.effect.name, better(problem, base, held)) for part in held]
    for count, name in enumerate(order, 1):
        shape = replace(final.shape, parts=tuple(p for p in final.shape.parts if p.effect.name in order[:count]))
        step = final if count == len(order) else fit(seen, shape, final.noise, rounds=2)
        out.append((name, better(problem, step, held)))
    return out


def tried(seen: Problem, found: Found, plain: Tested, accepted: Sequence[str]) -> tuple[Candidate, ...]:
    """Return every effect that was tried alone, the one with the smallest error on unseen samples first."""
    out = []
    before = found.judge.score(found.baseline)
    for name, trial in found.first.items():
        best = tested(seen, trial, rounds=1)
        effect = next(e for e in fitted_effects(seen, trial, closely=False) if e.effect == name)
        gain = before - found.judge.score(trial)
        gone = float(np.clip(1.0 - (best.rmse_holdout / plain.rmse_holdout) ** 2, 0.0, 1.0))
        verdict = "accepted" if name in accepted else "not needed"
        out.append(Candidate(**vars(effect), rmse_holdout=best.rmse_holdout, error_reduction=gone, evidence=gain,
                             verdict=verdict))
    return tuple(sorted(out, key=lambda c: (c.effect not in accepted, c.rmse_holdout)))


def confidence(found: Found, held: Sequence[Part], by_user: Sequence[str], alikes: Sequence[tuple[str, str]],
               reports: bool) -> dict[str, str]:
    """Return for each accepted effect how sure it is: clear, likely or stand_in; `held` by the recorder are clear.

    A stand-in lowers the error, but what is left matters beside it, or an effect of another kind does as well in its
    place. An effect of little evidence is likely. A look-alike of its own kind leaves open which of the two it is, not
    that one of them is there: both are named.
    reports: PV is known only where an exception test let it through, which looks like a valve that moves in jumps."""
    out = {part.effect.name: "clear" for part in held}
    for part in found.final.shape.parts:
        name, fitting = part.effect.name, part.effect.fitting
        others = [other for taken, other in alikes if taken == name]
        gain = found.gain(name)
        jumps = reports and not part.is_linear and part.effect.stage == Stage.VALVE
        if fitting.seldom or jumps or not found.left.adequate([gain]) or any(o not in fitting.siblings for o in others):
            out[name] = "stand_in"
        elif not found.adequate or name in by_user or gain < WEAK:
            out[name] = "likely"
        else:
            out[name] = "clear"
    return out


def margin(found: Found) -> tuple[float, str] | None:
    """Return by how much the best single effect beats the next, and the name of the next."""
    if len(found.first) < 2:
        return None
    (best, _), (second, name) = sorted((found.judge.score(trial), name) for name, trial in found.first.items())[:2]
    return None if found.judge.score(found.baseline) - best < ENOUGH else (second - best, name)
