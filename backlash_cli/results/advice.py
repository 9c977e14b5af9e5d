"""Advice to a person: what would decide a loop that a scan left undecided, and what compensation would do to a loop.

Signals are normalised, dead bands and gains of the compensator in spans of the output, times in seconds.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from ..record import Note

if TYPE_CHECKING:
    from ..simulator.controller import Controller
    from ..simulator.process import Process

ENOUGH, WRONG = 0.8, 0.05  # chance from which on an option is said to decide; the most of wrong answers


@dataclass(frozen=True)
class Course:
    """A stretch of a simulation, for the picture: time [s] and signals [spans], each (samples,)."""

    time: tuple[float, ...]
    setpoint: tuple[float, ...]
    measurement: tuple[float, ...]
    output: tuple[float, ...]
    valve: tuple[float, ...] = ()


@dataclass(frozen=True)
class PlanOption:
    """One thing to do, and its chance to decide; None where nothing was simulated."""

    kind: str  # wait, setpoint_steps, manual_test or logging
    text: str
    duration_s: float | None = None
    move: float | None = None  # one step of SP or of OP [span]
    levels: tuple[float, ...] = ()  # of SP or OP one after the other, in moves from where it stood
    hold_s: float | None = None  # how long each of them is held
    op_move: float | None = None  # how far the test alone moves OP [span]: in nine of ten repeats not further
    pv_move: float | None = None
    power: float | None = None  # share of repeats with a dead band of the target's size that are called `backlash`
    clears: float | None = None  # share with a healthy valve that are called `no_backlash`
    false_alarm: float | None = None  # share with a healthy valve that are called `backlash`
    missed: float | None = None  # share with a worn valve that are called `no_backlash`
    repeats: int = 0  # of each kind
    within_limits: bool = True  # False: it moves PV or OP further than was allowed
    worn: Course | None = field(default=None, repr=False)  # what to expect
    healthy: Course | None = field(default=None, repr=False)

    @property
    def rounds(self) -> int:
        """How many times the levels repeat themselves."""
        n = len(self.levels)
        return next((n // k for k in range(1, n) if self.levels[:k] * (n // k) == self.levels), 1)

    @property
    def decides(self) -> bool:
        """True where both a worn and a healthy valve would be told with enough chance, and hardly ever wrongly."""
        wrong = max(self.false_alarm or 0.0, self.missed or 0.0)
        return min(self.power or 0.0, self.clears or 0.0) >= ENOUGH and wrong <= WRONG


@dataclass(frozen=True)
class LoopPlan:
    """The options of one loop, the least that decides first, then those that do not."""

    loop: str
    verdict: str
    reason: str
    target: float  # dead band that matters [span]
    options: tuple[PlanOption, ...]
    model: str = ""  # what was simulated, in words
    pv_range: tuple[float, float] = field(default=(0.0, 1.0), repr=False)
    op_range: tuple[float, float] = field(default=(0.0, 1.0), repr=False)


@dataclass(frozen=True)
class Trial:
    """One compensator gain and what the simulation gave."""

    gain: float
    iae: float  # mean absolute error
    peak: float  # largest error
    limit_cycle: bool  # goes on oscillating without noise or load
    valve_travel_per_hour: float
    output_travel_per_hour: float
    reversals_per_hour: float  # of the valve


@dataclass(frozen=True, eq=False)
class CompensationStudy:
    """One loop: what is known of it before a compensator is simulated, then before and after, and the advice."""

    loop: str
    controller: Controller
    process: Process
    d: float  # dead band
    interval: tuple[float, float]  # its ends
    d_source: str  # "scan" or "given"
    density: float  # of the white measurement noise [span^2 s]
    output_noise: float  # standard deviation of the fast motion of the output
    hysteresis: float  # of the error's sign, simulated with every gain
    load: float  # typical load step at the process input
    rule_gain: float  # what the rule allows before any simulation, 0 for none
    reason: str  # why this gain, or why none; the rule's, before any simulation
    warnings: tuple[Note, ...] = ()
    seed: int = 0
    trials: tuple[Trial, ...] = ()  # by gain, the first without compensator
    recommended: float | None = None  # gain, None when refused
    refusals: tuple[Note, ...] = ()  # what speaks against
    before: Course | None = None
    after: Course | None = None  # with the recommended gain

    @property
    def base(self) -> Trial:
        """The loop as it is, without compensator."""
        return self.trials[0]

    def trial(self, gain: float) -> Trial:
        """Return the trial whose gain is closest."""
        return min(self.trials, key=lambda t: abs(t.gain - gain))
