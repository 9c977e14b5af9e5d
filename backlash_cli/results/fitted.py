"""What a fit found: numbers with their intervals, effects, candidates for a missing one, a model that can be kept."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from ..record import Note

Interval = tuple[float, float]


@dataclass(frozen=True)
class FittedParameter:
    """One number of a model, or several of a kind (times and sizes of load steps).

    value: one number, or a tuple of them. ci95: its 95 % interval, or one interval for each number; None when it was
    not fitted. unit: as in the effect ("span", "s", "1/s", "OP span", ...). nuisance: says how the record began only.
    level: a place on the scale (a stop at 20 %), not an amount (a gap of 2 %).
    """

    value: float | tuple[float, ...]
    unit: str = ""
    ci95: Interval | tuple[Interval, ...] | None = None
    meaning: str = ""
    nuisance: bool = False
    level: bool = False


@dataclass(frozen=True)
class FittedEffect:
    """One accepted effect with its numbers, as fitted together with the others.

    column: measured column it uses, if any. sentence: what the effect is. meaning: what it says about this plant, with
    {name} where a parameter belongs. stage: command, valve, process, load or sensor. notes: where its size is small.
    confidence: "clear", "likely", or "stand_in" where it lowers the error but something else may be the cause; "" where
    it was not judged.
    """

    effect: str
    parameters: Mapping[str, FittedParameter] = field(default_factory=dict)
    column: str = ""
    sentence: str = ""
    meaning: str = ""
    stage: str = ""
    notes: tuple[Note, ...] = ()
    confidence: str = ""


@dataclass(frozen=True)
class Candidate:
    """One effect tried at the first step: how far it alone lowers the error on samples the fit did not see.

    error_reduction: share of the squared hold-out error of the baseline that goes, 0..1. evidence: difference of the
    information criterion, positive in favour of the effect. verdict: "accepted", "not needed". why: why not.
    """

    effect: str
    rmse_holdout: float
    error_reduction: float
    parameters: Mapping[str, FittedParameter] = field(default_factory=dict)
    column: str = ""
    evidence: float | None = None
    verdict: str = ""
    sentence: str = ""
    meaning: str = ""
    stage: str = ""
    why: Note | None = None


def gap_size(effect: Candidate | FittedEffect) -> float | None:
    """Return the size of a gap that OP must cross in the valve [span], None for an effect that is no gap."""
    if effect.stage != "valve":
        return None
    sizes = [p.value for p in effect.parameters.values() if p.unit == "span" and not p.nuisance and not p.level]
    return sizes[0] if sizes and isinstance(sizes[0], float) else None


@dataclass(frozen=True)
class ModelEffect:
    """One effect in a model: its name, or module:NAME of one from outside, with plain parameter values."""

    effect: str
    parameters: Mapping[str, float | tuple[float, ...]] = field(default_factory=dict)
    column: str = ""
    source: str = ""

    @property
    def reference(self) -> str:
        """What finds the effect again: `module:NAME` for one from outside, else its name."""
        return self.source or self.effect


@dataclass(frozen=True)
class Model:
    """A model of one loop that can be kept: PV = Kp * lag(tau, effects(OP delayed by theta)) + offset.

    Kp: static gain [PV span / OP span]. tau, theta: seconds. offset: [PV span]. start: epoch seconds of the first
    sample it was fitted to; times within effects count from there. interval: seconds between its samples.
    pv_range, op_range: spans the normalised numbers belong to; None when not known.
    rmse_holdout: error it had on the record it was fitted to. output: where OP was then, all but 2 % of the time.
    """

    loop: str
    Kp: float
    tau: float
    offset: float = 0.0
    theta: float = 0.0
    effects: tuple[ModelEffect, ...] = ()
    start: float | None = None
    end: float | None = None
    interval: float | None = None
    pv_range: Interval | None = None
    op_range: Interval | None = None
    rmse_holdout: float | None = None
    output: Interval | None = None

    def without(self, name: str) -> Model:
        """Return the model without the effect called `name`."""
        return replace(self, effects=tuple(e for e in self.effects if e.effect != name))


@dataclass(frozen=True)
class Fitness:
    """How well a model fits one record: errors and the numbers of the first-order part (Kp, tau, theta, offset)."""

    rmse: float
    rmse_holdout: float
    parameters: Mapping[str, FittedParameter] = field(default_factory=dict)
