"""What comparing a model with the measurements found, and which physical effects explain the difference.

All errors are root mean squares of measured minus predicted PV, normalised (0.01 = 1 % of the measurement span); times
are in seconds, those of day in epoch seconds."""

from collections.abc import Mapping
from dataclasses import KW_ONLY, field, replace

import numpy as np

from ..record import BoolArray, FloatArray, Frozen, LoopSettings, Note
from .scan import PlantResult

Interval = tuple[float, float]


class FittedParameter(Frozen):
    """One number of a model, or several of a kind (times and sizes of load steps)."""

    value: float | tuple[float, ...]
    unit: str = ""  # as in the effect: "span", "s", "1/s", "OP span", ...
    ci95: Interval | tuple[Interval, ...] | None = None  # 95 %, one for each number; None when it was not fitted
    meaning: str = field(default="", repr=False)
    nuisance: bool = field(default=False, repr=False)  # says how the record began only
    level: bool = field(default=False, repr=False)  # a place on the scale (a stop at 20 %), not an amount (2 %)


class FittedEffect(Frozen):
    """One effect with its numbers, as fitted together with the others."""

    effect: str
    parameters: Mapping[str, FittedParameter] = field(default_factory=dict)
    column: str = ""  # measured column it uses
    sentence: str = ""  # what the effect is
    meaning: str = ""  # what it says about this plant, with {name} where a parameter belongs
    stage: str = ""  # command, valve, process, load or sensor
    notes: tuple[Note, ...] = ()  # where its size is small
    # "clear", "likely", or "stand_in" where it lowers the error but something else may be the cause; "" not judged
    confidence: str = ""

    @property
    def gap(self) -> float | None:
        """Size of a gap that OP must cross in the valve [span], None for an effect that is no gap."""
        sizes = [p.value for p in self.parameters.values() if p.unit == "span" and not p.nuisance and not p.level]
        return sizes[0] if self.stage == "valve" and sizes and isinstance(sizes[0], float) else None


class Candidate(FittedEffect):
    """One effect tried at the first step: how far it alone lowers the error on samples the fit did not see."""

    _: KW_ONLY
    rmse_holdout: float
    error_reduction: float  # share of the squared hold-out error of the baseline that goes, 0..1
    evidence: float | None = None  # difference of the information criterion, positive in favour of the effect
    verdict: str = ""  # "accepted", "not needed"
    why: Note | None = None  # why not


class ModelEffect(Frozen):
    """One effect in a model, with plain parameter values."""

    effect: str
    parameters: Mapping[str, float | tuple[float, ...]] = field(default_factory=dict)
    column: str = ""
    source: str = ""  # module:NAME of one from outside

    @property
    def reference(self) -> str:
        """What finds the effect again."""
        return self.source or self.effect


class Model(Frozen):
    """A model of one loop that can be kept: PV = Kp * lag(tau, effects(OP delayed by theta)) + offset."""

    loop: str
    Kp: float  # [PV span / OP span]
    tau: float
    offset: float = 0.0  # [PV span]
    theta: float = 0.0
    effects: tuple[ModelEffect, ...] = ()
    start: float | None = None  # of the samples it was fitted to; times within effects count from there
    end: float | None = None
    interval: float | None = None  # between its samples
    pv_range: Interval | None = None  # spans the normalised numbers belong to
    op_range: Interval | None = None
    rmse_holdout: float | None = field(default=None, repr=False)  # on the record it was fitted to
    output: Interval | None = None  # where OP was then, all but 2 % of the time

    def without(self, name: str) -> "Model":
        """Return the model without the effect called `name`."""
        return replace(self, effects=tuple(e for e in self.effects if e.effect != name))


class Fitness(Frozen):
    """How well a model fits one record: errors and the numbers of the first-order part (Kp, tau, theta, offset)."""

    rmse: float
    rmse_holdout: float
    parameters: Mapping[str, FittedParameter] = field(default_factory=dict)


class Step(Frozen, eq=False):
    """One rung of the ladder: the model after `added` came in (None: the baseline), everything refitted together."""

    added: str | None
    rmse_holdout: float
    rmse: float | None = None
    prediction: FloatArray | None = field(default=None, repr=False)  # PV (samples,) as in the series, if kept
    chosen: str = "search"  # or "user": --add, or part of the model file


class Region(Frozen):
    """A part of the record, and how badly the model does there."""

    region: str  # short name: "after output reversals, upwards"
    rmse: float
    share: float  # of the squared error of the whole record
    samples: int
    kind: str = ""  # of regions that cut the record in one way: "reversal", "setpoint", "frequency", "time", ...
    expected: float | None = None  # share of all usable samples; below `share` where the model is worse than on average
    sentence: str = ""  # in words an engineer understands
    stretches: tuple[Interval, ...] = field(default=(), repr=False)  # (first, last) times; none of a frequency band


class Series(Frozen, eq=False):
    """What was measured and what the model says, on a grid without gaps; all (samples,), normalised, nan in holes."""

    time: FloatArray
    setpoint: FloatArray
    output: FloatArray
    measured: FloatArray
    predicted: FloatArray
    used: BoolArray  # where the sample counts
    inside: Mapping[str, FloatArray] = field(default_factory=dict)  # between OP and PV; "valve": stem position

    def residual(self, predicted: FloatArray) -> FloatArray:
        """Measured minus predicted PV (samples,), nan where the sample does not count."""
        return np.where(self.used, self.measured - predicted, np.nan)


class Judged(Frozen, eq=False):
    """A model against one record: how far off it is, how far off it could be at best, and where it fails."""

    loop: str
    baseline: Fitness  # the plain first-order model fitted to the same record
    noise_floor: float  # standard deviation of the measurement noise
    _: KW_ONLY
    where: tuple[Region, ...] = ()  # worst first
    effects: tuple[FittedEffect, ...] = ()  # accepted, in the order they were accepted
    unexplained: float | None = None  # share of the squared error above the noise floor that stays
    reasons: tuple[Note, ...] = ()  # why nothing can be told, or why a kept model does no better than the plain one
    warnings: tuple[Note, ...] = ()
    series: Series | None = field(default=None, repr=False)
    settings: LoopSettings = field(default_factory=LoopSettings, repr=False)
    model: Model | None = None
    details: Mapping[str, object] = field(default_factory=dict)


class Comparison(Judged, eq=False, kw_only=True):
    """One model against one record."""

    fitness: Fitness
    fitted: bool = True  # False: the model file's numbers were kept, only offset and start matched to the record
    seen: float = 1.0  # share of the samples that the model's numbers were fitted to; 0 on another day


class Rest(Frozen):
    """What the final model leaves: how many times the measurement noise, and what it goes with, in words."""

    times_noise: float
    goes_with: tuple[str, ...] = ()


class Explanation(Judged, eq=False, kw_only=True):
    """Which physical effects are missing in the first-order model of a loop, and how far the error falls with them."""

    candidates: tuple[Candidate, ...] = ()  # tried alone, best first
    steps: tuple[Step, ...] = ()  # the ladder, first the baseline
    missing_effect: str | None = None  # the first accepted, None when nothing is missing
    where_before: tuple[Region, ...] = ()  # as `where`, of the baseline
    adequate: bool | None = None  # what is left is what noise and a wandering load would leave; None: not judged
    rest: Rest | None = None
    look_alikes: tuple[tuple[str, str], ...] = ()  # (effect, other) that the data cannot tell apart
    margin: tuple[float, str] | None = None  # evidence of the first accepted effect over the runner-up, and its name
    verdict: str = ""  # one plain sentence
    final: Fitness | None = None

    def light(self) -> "Explanation":
        """Return the explanation without its series and predictions, for a summary of many loops."""
        return replace(self, series=None, steps=tuple(replace(s, prediction=None) for s in self.steps))

    @property
    def rmse_holdout(self) -> float:
        """Hold-out error of the final model."""
        return self.steps[-1].rmse_holdout if self.steps else self.baseline.rmse_holdout


class PlantExplanation(PlantResult):
    """The explanations of a whole plant."""

    loops: tuple[Explanation, ...]
