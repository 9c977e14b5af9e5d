"""Advice to a person: what would decide a loop that a scan left undecided; signals normalised, times in seconds."""

from dataclasses import field

from ..record import Frozen

ENOUGH, WRONG = 0.8, 0.05  # chance from which on an option is said to decide; the most of wrong answers


class Course(Frozen):
    """A stretch of a simulation, for the picture: time [s] and signals [spans], each (samples,)."""

    time: tuple[float, ...]
    setpoint: tuple[float, ...]
    measurement: tuple[float, ...]
    output: tuple[float, ...]
    valve: tuple[float, ...] = ()


class PlanOption(Frozen):
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


class LoopPlan(Frozen):
    """The options of one loop, the least that decides first, then those that do not."""

    loop: str
    verdict: str
    reason: str
    target: float  # dead band that matters [span]
    options: tuple[PlanOption, ...]
    model: str = ""  # what was simulated, in words
    pv_range: tuple[float, float] = field(default=(0.0, 1.0), repr=False)
    op_range: tuple[float, float] = field(default=(0.0, 1.0), repr=False)
