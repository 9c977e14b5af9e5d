"""What comparing a model with the measurements found, and which physical effects explain the difference.

All errors are root mean squares of measured minus predicted PV, normalised (0.01 = 1 % of the measurement span).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ..record import FloatArray, LoopSettings, Note
from .fitted import Candidate, Fitness, FittedEffect, Interval, Model


@dataclass(frozen=True, eq=False)
class Step:
    """One rung of the ladder: the model after `added` came in (None: the baseline), everything refitted together.

    prediction: (samples,) PV predicted by this model on the time axis of the series, None where not kept.
    chosen: "search" or "user" (--add, or part of the model file).
    """

    added: str | None
    rmse_holdout: float
    rmse: float | None = None
    prediction: FloatArray | None = field(default=None, repr=False)
    chosen: str = "search"


@dataclass(frozen=True)
class Region:
    """A part of the record, and how badly the model does there.

    region: short name ("after output reversals, upwards"). kind: group of regions that cut the record in one way, such
    as "reversal", "setpoint", "output level", "direction", "limit", "frequency", "time", "load". rmse: error there.
    share: of the squared error of the whole record. samples: in the region. expected: share of all usable samples, so
    that share / expected > 1 says where the model is worse than on average. sentence: in words an engineer understands.
    stretches: (first, last) pairs of epoch seconds, for shading; empty for a frequency band.
    """

    region: str
    rmse: float
    share: float
    samples: int
    kind: str = ""
    expected: float | None = None
    sentence: str = ""
    stretches: tuple[Interval, ...] = ()


@dataclass(frozen=True, eq=False)
class Series:
    """What was measured and what the model says, on a grid without gaps; all (samples,), normalised, nan in holes.

    time: epoch seconds. used: bool, where the sample counts. residual is measured minus predicted.
    inside: named signals between OP and PV ("valve": stem position), for pictures.
    """

    time: FloatArray
    setpoint: FloatArray
    output: FloatArray
    measured: FloatArray
    predicted: FloatArray
    used: NDArray[np.bool_]
    inside: Mapping[str, FloatArray] = field(default_factory=dict)

    @property
    def residual(self) -> FloatArray:
        """Measured minus predicted PV (samples,), nan where the sample does not count."""
        return np.where(self.used, self.measured - self.predicted, np.nan)

    @property
    def moved(self) -> dict[str, FloatArray]:
        """The signals inside the model that differ from OP; without an effect on its way the stem follows OP."""
        return {name: v for name, v in self.inside.items() if not np.allclose(v, self.output, rtol=0.0, atol=1e-9)}


@dataclass(frozen=True, eq=False)
class Comparison:
    """One model against one record: how far off it is, how far off it could be at best, and where it fails.

    baseline: the plain first-order model fitted to the same record, to judge by. fitness: the model compared.
    where: worst first. noise_floor: standard deviation of the measurement noise. unexplained: share of the squared
    error above the noise floor that this model leaves, 1 for the baseline. fitted: False when the numbers of the
    model file were kept and only offset and start were matched to the record. seen: share of the samples that the
    model's numbers were fitted to: 1 for the record it was made from, 0 for another day. reasons: why a kept model does
    no better here than the plain one fitted to this record, as far as that can be seen.
    """

    loop: str
    baseline: Fitness
    fitness: Fitness
    noise_floor: float
    where: tuple[Region, ...] = ()
    effects: tuple[FittedEffect, ...] = ()
    unexplained: float | None = None
    series: Series | None = field(default=None, repr=False)
    warnings: tuple[Note, ...] = ()
    settings: LoopSettings = field(default_factory=LoopSettings)
    model: Model | None = None
    fitted: bool = True
    seen: float = 1.0
    reasons: tuple[Note, ...] = ()
    details: Mapping[str, object] = field(default_factory=dict)


@dataclass(frozen=True)
class Rest:
    """What the final model leaves: how many times the measurement noise, and what it goes with, in words."""

    times_noise: float
    goes_with: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Explanation:
    """Which physical effects are missing in the first-order model of a loop, and how far the error falls with them.

    candidates: effects tried alone, best first. steps: the ladder, first the baseline. effects: accepted, in the order
    they were accepted, numbers as fitted together. missing_effect: the first of them, None when nothing is missing.
    where: of the final model, worst first; where_before: of the baseline. unexplained: share of the squared error
    above the noise floor that no effect removed. look_alikes: (effect, other) pairs that the data cannot tell apart.
    adequate: what is left is what noise and a wandering load would leave; rest: what it is. None where not judged.
    margin: evidence of the first accepted effect over the runner-up, with the runner-up's name.
    verdict: one plain sentence. reasons: why, for instance why nothing can be told.
    """

    loop: str
    baseline: Fitness
    noise_floor: float
    candidates: tuple[Candidate, ...] = ()
    steps: tuple[Step, ...] = ()
    effects: tuple[FittedEffect, ...] = ()
    missing_effect: str | None = None
    where: tuple[Region, ...] = ()
    where_before: tuple[Region, ...] = ()
    unexplained: float | None = None
    adequate: bool | None = None
    rest: Rest | None = None
    look_alikes: tuple[tuple[str, str], ...] = ()
    margin: tuple[float, str] | None = None
    verdict: str = ""
    reasons: tuple[Note, ...] = ()
    warnings: tuple[Note, ...] = ()
    series: Series | None = field(default=None, repr=False)
    settings: LoopSettings = field(default_factory=LoopSettings)
    final: Fitness | None = None
    model: Model | None = None
    details: Mapping[str, object] = field(default_factory=dict)

    def light(self) -> Explanation:
        """Return the explanation without its series and predictions, for a summary of many loops."""
        return replace(self, series=None, steps=tuple(replace(s, prediction=None) for s in self.steps))

    @property
    def rmse_holdout(self) -> float:
        """Hold-out error of the final model."""
        return self.steps[-1].rmse_holdout if self.steps else self.baseline.rmse_holdout


@dataclass(frozen=True, eq=False)
class PlantExplanation:
    """A whole plant: the explanations in the order of the loops, what could not be explained, and the inputs."""

    loops: tuple[Explanation, ...]
    failures: tuple[Note, ...] = ()
    inputs: tuple[str, ...] = ()
    warnings: tuple[Note, ...] = ()
