"""What compensation would do to one loop: the same simulation with a range of gains, and the advice drawn from it.

Signals are normalised, gains of the compensator and dead bands in spans of the output, times in seconds.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from ..record import Note
from .plan import Course


@dataclass(frozen=True)
class ProcessModel:
    """The process that was simulated."""

    gain: float  # [measurement span / output span]
    lags: tuple[float, ...]
    dead_time: float
    integrating: bool = False
    source: str = "given"  # or "fitted"
    evidence: float | None = None  # fall of -2 log likelihood that the fitted process brings
    profile: tuple[tuple[float, float], ...] = field(default=(), repr=False)  # (dead band, evidence) of smaller ones


@dataclass(frozen=True)
class Trial:
    """One compensator gain and what the simulation gave."""

    gain: float
    iae: float  # mean absolute error
    peak: float  # largest error
    travel: float  # way of the valve [span per hour]
    output_travel: float  # way of the controller output [span per hour]
    reversals: float  # of the valve, per hour
    limit_cycle: bool  # goes on oscillating without noise or load


@dataclass(frozen=True, eq=False)
class CompensationStudy:
    """Before and after for one loop, and the advice."""

    loop: str
    settings: Mapping[str, float]
    d: float  # dead band
    interval: tuple[float, float]  # its ends
    d_source: str  # "scan" or "given"
    process: ProcessModel
    output_noise: float  # standard deviation of the fast motion of the output
    hysteresis: float  # of the error's sign, simulated with every gain
    load: float  # typical load step
    trials: tuple[Trial, ...]  # by gain, the first without compensator
    rule_gain: float  # what the rule allows before any simulation
    recommended: float | None  # gain, None when refused
    reason: str  # why this gain, or why none
    refusals: tuple[Note, ...] = ()  # what speaks against
    warnings: tuple[Note, ...] = ()
    before: Course | None = None
    after: Course | None = None  # with the recommended gain

    @property
    def base(self) -> Trial:
        """The loop as it is, without compensator."""
        return self.trials[0]

    def trial(self, gain: float) -> Trial:
        """Return the trial whose gain is closest."""
        return min(self.trials, key=lambda t: abs(t.gain - gain))
