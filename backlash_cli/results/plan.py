"""What would decide a loop that a scan left undecided: options, each with its chance, and what they would look like."""

from __future__ import annotations

from dataclasses import dataclass

ENOUGH, WRONG = 0.8, 0.05  # chance from which on an option is said to decide; the most of wrong answers


@dataclass(frozen=True)
class Course:
    """One simulated course of a test, for the picture: time [s] from its start, PV and OP [spans]."""

    time: tuple[float, ...]
    setpoint: tuple[float, ...]
    measurement: tuple[float, ...]
    output: tuple[float, ...]


@dataclass(frozen=True)
class PlanOption:
    """One thing to do, and its chance to decide.

    kind: wait, setpoint_steps, manual_test or logging. duration_s: how long it takes. move: one step of SP or of OP
    [span]. levels: of SP or OP one after the other, in moves from where it stood. hold_s: how long each is held.
    op_move, pv_move: how far the test alone moves OP and PV [spans]: in nine of ten repeats not further.
    power: share of repeats with a dead band of the target's size that the scan calls `backlash`. clears: share with a
    healthy valve that it calls `no_backlash`. false_alarm: share with a healthy valve that it calls `backlash`, missed:
    of worn valves that it clears. repeats: of each kind. All of these None where nothing was simulated. worn, healthy:
    the courses to expect.
    """

    kind: str
    text: str
    duration_s: float | None = None
    move: float | None = None
    levels: tuple[float, ...] = ()
    hold_s: float | None = None
    op_move: float | None = None
    pv_move: float | None = None
    power: float | None = None
    clears: float | None = None
    false_alarm: float | None = None
    missed: float | None = None
    repeats: int = 0
    worn: Course | None = None
    healthy: Course | None = None

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
    """The options of one loop, the least that decides first, then those that do not.

    target: dead band that matters [span]. model: what was simulated, in words. pv_range, op_range: engineering values
    of 0 and 1.
    """

    loop: str
    verdict: str
    reason: str
    target: float
    options: tuple[PlanOption, ...]
    model: str = ""
    pv_range: tuple[float, float] = (0.0, 1.0)
    op_range: tuple[float, float] = (0.0, 1.0)
