"""What compensation would do to one loop: the same simulation with a range of gains, and the advice drawn from it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from ..record import FloatArray, Note


@dataclass(frozen=True)
class ProcessModel:
    """The process that was simulated: gain [measurement span / output span], lags and dead time [s].

    source: "given" or "fitted". evidence: fall of -2 log likelihood that the fitted process brings, None if given.
    profile: (dead band, evidence) pairs for smaller dead bands, the same process.
    """

    gain: float
    lags: tuple[float, ...]
    dead_time: float
    integrating: bool = False
    source: str = "given"
    evidence: float | None = None
    profile: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True)
class Trial:
    """One compensator gain [span of output] and what the simulation gave.

    iae: mean absolute error [span]. peak: largest error [span]. travel: way of the valve [span per hour].
    output_travel: way of the controller output [span per hour]. reversals: of the valve, per hour. limit_cycle: the
    loop goes on oscillating without noise or load.
    """

    gain: float
    iae: float
    peak: float
    travel: float
    output_travel: float
    reversals: float
    limit_cycle: bool


@dataclass(frozen=True, eq=False)
class Glimpse:
    """A stretch of the simulation for the picture: time [s] and signals (samples,), normalised."""

    gain: float
    time: FloatArray
    measurement: FloatArray
    setpoint: FloatArray
    output: FloatArray
    valve: FloatArray


@dataclass(frozen=True, eq=False)
class CompensationStudy:
    """Before and after for one loop; all signals normalised, times in seconds.

    d: dead band, interval: its ends, d_source: "scan" or "given". output_noise: standard deviation of the fast
    motion of the output. hysteresis: of the error's sign, simulated with every gain. load: typical load step.
    trials: by gain, the first without compensator. rule_gain: what the rule allows before any simulation.
    recommended: gain, None when refused. reason: why this gain, or why none. refusals: what speaks against.
    """

    loop: str
    settings: Mapping[str, float]
    d: float
    interval: tuple[float, float]
    d_source: str
    process: ProcessModel
    output_noise: float
    hysteresis: float
    load: float
    trials: tuple[Trial, ...]
    rule_gain: float
    recommended: float | None
    reason: str
    refusals: tuple[Note, ...] = ()
    warnings: tuple[Note, ...] = ()
    before: Glimpse | None = None
    after: Glimpse | None = None

    @property
    def base(self) -> Trial:
        """The loop as it is, without compensator."""
        return self.trials[0]

    def trial(self, gain: float) -> Trial:
        """Return the trial whose gain is closest."""
        return min(self.trials, key=lambda t: abs(t.gain - gain))
