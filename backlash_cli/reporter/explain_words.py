"""How errors, steps and answers of the workbench are said to a person, the same in the terminal and on a page."""

from __future__ import annotations

import math
from collections.abc import Sequence

from ..record import LoopSettings
from ..results import Candidate, Comparison, Explanation, FittedEffect, Region, Step
from .parameter_words import meaning
from .safe import terminal
from .words import duration, moment

ABOUT = 0.1  # errors closer than this share say the same
WORSE = 1.15  # share of the error over share of the time, from which a region is worth a line
MUCH = 2.0  # error over noise from which "nothing is missing" needs a word more

# reasons of `compare` that say that the plant is not as it was
CHANGED = ("other_operating_point", "process_changed", "numbers_changed", "effect_not_here")
NOT_TRIED, NOT_EXPLAINED = "not_tried", "not_explained"
# why an effect that was tried is not in the model, by code
WHY = {
    "no_better_prediction": "unseen samples predicted no better",
    "little_evidence": "better, but no more than chance may give",
    "other_explains": "another effect explains the same error better",
    "look_alike": "a look-alike was taken, cannot be told apart",
    "look_alike_better": "a look-alike fits better",
    "below_resolution": "smaller than the recording shows",
    "fits_nothing": "fits best where it does nothing",
    "op_never_turns": "OP never turns back",
    "too_little_motion": "too little motion to tell",
    NOT_TRIED: "nothing pointed to it",
    NOT_EXPLAINED: "loop could not be explained",
}


def error_size(value: float | None) -> str:
    """An error in per cent of the measurement span with three digits, e.g. '0.812 %'."""
    return "–" if value is None or not math.isfinite(value) else f"{100 * value:.3g} %"


def share(value: float | None) -> str:
    """A share of a whole in whole per cent, e.g. '41 %'; two digits of small ones."""
    if value is None or not math.isfinite(value):
        return "–"
    if abs(value) >= 0.0995 or abs(value) < 0.0005:
        return f"{100 * value:.0f} %"
    return f"{100 * value:.2g} %"


def plain_name(effect: str) -> str:
    """The name of an effect in words: 'dead time' for dead_time."""
    return terminal(effect.replace("_", " "), 60)


def rung(step: Step) -> str:
    """What a step of the ladder added: 'baseline', '+ dead time'."""
    return "baseline" if step.added is None else f"+ {plain_name(step.added)}"


def ladder(steps: Sequence[Step], noise_floor: float) -> str:
    """The ladder in one line.

    >>> ladder([Step(None, 0.032), Step("dead_time", 0.021), Step("backlash", 0.008)], 0.0075)
    'baseline 3.2 % -> + dead time 2.1 % -> + backlash 0.8 % (noise floor 0.75 %)'
    """
    rungs = " -> ".join(f"{rung(step)} {error_size(step.rmse_holdout)}" for step in steps)
    return f"{rungs} (noise floor {error_size(noise_floor)})"


def listed(names: Sequence[str]) -> str:
    """Names as in a sentence.

    >>> listed(["dead time", "backlash", "load step"])
    'dead time, backlash and load step'
    """
    return " and ".join(filter(None, [", ".join(names[:-1]), *names[-1:]]))


FIRST_ORDER = {"Kp": "static gain", "tau": "time constant", "theta": "dead time", "offset": "offset"}
KIN = {frozenset(("backlash", "stiction"))}  # one valve has one of them: said in one breath


def look_alike_words(explanation: Explanation) -> list[str]:
    """One sentence for each pair of effects that this record cannot tell apart."""
    said = []
    for a, b in explanation.look_alikes:
        one = f"{plain_name(a).capitalize()} and {plain_name(b)} explain this record about equally well: it cannot "
        one += "tell them apart."
        if frozenset((a, b)) in KIN:
            one += _which_of_both(explanation, a, b)
        said.append(one)
    return said


def _which_of_both(e: Explanation, a: str, b: str) -> str:
    """The band that backlash and stiction agree on, and the record that would tell them apart."""
    tried: list[FittedEffect | Candidate] = [*e.effects, *e.candidates]
    sizes = [p.value for x in tried if x.effect in (a, b) for n, p in x.parameters.items()
             if n in ("d", "S") and isinstance(p.value, float)]
    band = f"Either way the output must travel {share(sizes[0])} of its span before the stem turns. " if sizes else ""
    return (f" {band}A slow ramp of the output by hand, up and down again, recorded every second, would tell: PV "
            "follows in jumps where the valve sticks, and evenly after the gap where it has play.")


def effect_name(explanation: Explanation, effect: str) -> str:
    """The name of an accepted effect, with its twin where the record cannot tell them apart."""
    twin = [b for a, b in explanation.look_alikes if a == effect and frozenset((a, b)) in KIN]
    return " or ".join(plain_name(name) for name in sorted([effect, *twin]))


SURENESS = {
    "likely": "Likely, not certain: it explains little, or something much like it does nearly as well.",
    "stand_in": "Acts like this, but may be something else: the numbers are conditional, right only if it is this.",
}


def effect_words(effect: FittedEffect, settings: LoopSettings, start: float | None) -> list[str]:
    """What an accepted effect means in the plant, how sure it is, and what makes it doubtful or harmless."""
    sure = [SURENESS[effect.confidence]] if effect.confidence in SURENESS else []
    return [meaning(effect, settings, start), *sure, *(f"Take care: {note.message}." for note in effect.notes)]


def unexplained_words(found: Comparison | Explanation) -> str:
    """How much of the error stays; empty where it is not known."""
    if found.unexplained is None:
        return ""
    left = share(found.unexplained)
    stays = f"this model leaves {left} unexplained" if isinstance(found, Comparison) else f"{left} stays unexplained"
    return f"Of the squared error above the noise, {stays}."


def rest_words(explanation: Explanation) -> str:
    """What is left, and what it goes with; empty where it was not judged."""
    e = explanation
    if e.rest is None or e.adequate is None:
        return ""
    times = f"What is left is {e.rest.times_noise:.2g} times the noise"
    goes = "; ".join(e.rest.goes_with)
    if e.adequate:
        faint = f" Faintly it goes with {goes}." if goes else ""
        return f"{times}, as a wandering load and noise would leave it.{faint}"
    return f"{times} and more than noise and load: it goes with {goes}."


def candidate_verdict(explanation: Explanation, candidate: Candidate) -> str:
    """What became of an effect that was tried, in a word or two."""
    for accepted, other in explanation.look_alikes:
        if candidate.effect == other:
            return f"looks like {plain_name(accepted)}"
    if candidate.why is not None:
        return WHY.get(candidate.why.code, candidate.verdict)
    return candidate.verdict


def verdict(explanation: Explanation) -> str:
    """The answer in one sentence."""
    if explanation.verdict:
        return explanation.verdict
    added = explanation.steps[1:]
    sure = {e.effect: e.confidence for e in explanation.effects}
    found = [s.added or "" for s in added if s.chosen == "search"]
    own = listed([plain_name(s.added or "") for s in added if s.chosen != "search"])
    said = []
    if own:
        said.append(
            f"With your own choice, {own}, the error on unseen samples goes from "
            f"{error_size(explanation.steps[0].rmse_holdout)} to {error_size(_after_own(added))}."
        )
    model = "model" if own else "plain model"
    taken = [name for name in found if sure.get(name) != "stand_in"]
    if taken:
        names = listed([effect_name(explanation, name) + " (likely)" * (sure.get(name) == "likely") for name in taken])
        with_it = "it" if len(taken) == 1 else "them"
        said.append(f"Missing in the {model}: {names}. The error on unseen samples falls with {with_it}.")
    if stand_ins := [effect_name(explanation, name) for name in found if sure.get(name) == "stand_in"]:
        also = listed([plain_name(b) for a, b in explanation.look_alikes if sure.get(a) == "stand_in"])
        said.append(
            f"{'What else is missing' if taken else 'What is missing'} acts like {listed(stand_ins)}, but may be "
            f"something else{f': {also} would look the same' if also else ''}."
        )
    if explanation.adequate is False:
        said.append(rest_words(explanation))
    if not added:
        said.append("Nothing is missing: no effect that was tried predicts this record better than the plain model.")
        times = explanation.baseline.rmse_holdout / max(explanation.noise_floor, 1e-12)
        if times > MUCH and explanation.adequate is not False:
            said.append(f"The error is {times:.2g} times the noise, though: what remains is load that nobody measured, "
                        "or something that is not among the effects.")
    return " ".join(said)


def _after_own(added: Sequence[Step]) -> float:
    """The error after the last step of the user's own choice."""
    return [s.rmse_holdout for s in added if s.chosen != "search"][-1]


def still_holds(c: Comparison) -> str:
    """Whether a model that was kept predicts this record too; empty where no model was given."""
    if c.fitted or c.model is None:
        return ""
    here, before = error_size(c.fitness.rmse_holdout), c.model.rmse_holdout
    if c.seen > 1.0 - ABOUT:
        said = ("This is the record that the model was fitted to, so its fit here flatters it; hold-out is the error "
                "that the file keeps from that fit. Another day tells more. ")
    elif c.seen > 0.0:
        said = f"The model was fitted to {share(c.seen)} of this record; hold-out is the error on the rest. "
    else:
        said = "" if before is None else (
            f"On the record it was fitted to its hold-out error was {error_size(before)}; on this one, of which it has "
            f"seen nothing, it is {here}. "
        )
    ratio = c.fitness.rmse_holdout / c.baseline.rmse_holdout if c.baseline.rmse_holdout > 0 else math.inf
    if ratio < 1.0 - ABOUT:
        return said + "The model holds here: it predicts this record better than a plain model fitted to it."
    if ratio < 1.0 + ABOUT:
        return said + "It predicts this record about as well as a plain model fitted to it."
    said += "The model does not hold here: a plain model fitted to this record does better. "
    if any(note.code in CHANGED for note in c.reasons):
        return said + "The plant has changed, or was not well known: see the reasons."
    return said + ("No change of the process or of an effect explains it: a load has passed that no model can know, or "
                   "something that is not among the effects.")


def fails(regions: Sequence[Region]) -> list[Region]:
    """The regions whose share of the error is clearly larger than their share of the time, worst first."""
    return [r for r in regions if r.expected is None or r.share >= WORSE * r.expected]


def predicted_name(found: Comparison | Explanation) -> str:
    """What the prediction is: of PV from OP alone, or a short time ahead where OP answers to the load."""
    for note in found.warnings:
        if note.code in ("load_driven", "predicted_ahead") and isinstance(ahead := note.values.get("ahead_s"), float):
            return f"PV predicted {duration(ahead)} ahead"
    return "PV predicted"


def inside_name(name: str) -> str:
    """A signal within the model in words: where the stem is as the model sees it."""
    return "stem (model)" if name == "valve" else plain_name(name)


def start_of(found: Comparison | Explanation) -> float | None:
    """Epoch seconds of the first sample, None where the samples were not kept."""
    return None if found.series is None else float(found.series.time[0])


def span_words(found: Comparison | Explanation) -> str:
    """Which record this is about: from when to when, how many samples, how far apart."""
    series = found.series
    if series is None or len(series.time) == 0:
        return ""
    used = int(series.used.sum())
    every = duration(float(series.time[1] - series.time[0])) if len(series.time) > 1 else "–"
    return f"{moment(float(series.time[0]))} to {moment(float(series.time[-1]))}, {used} samples, every {every}"
