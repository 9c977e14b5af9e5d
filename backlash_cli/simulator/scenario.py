"""What a simulation needs to know: controller, process, effects, setpoint, load, recorder; and what it planted."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import field
from typing import Any

import numpy as np

from ..effects.registry import load_effect
from ..effects.shape import Effect
from ..errors import MetadataError
from ..record import FloatArray, Frozen, LoopSettings
from .controller import Compensator, Controller
from .process import Process

LARGEST = 10.0  # spans; a signal that rests further out is an engineering value, not a normalised one
Row = tuple[str, str, str, str, str]


class Applied(Frozen, eq=False):
    """An effect with its parameter array; `column` names the measured signal of an effect that takes one."""

    effect: Effect
    p: FloatArray
    column: str | None = None


def use(name: str | Effect, *, column: str | None = None, **parameters: object) -> Applied:
    """Return an effect with its parameters, for example use("backlash", d=0.03).

    name: a name of `backlash effects`, `module:NAME`, or an Effect. Raises MetadataError for what does not exist."""
    effect = name if isinstance(name, Effect) else load_effect(name)
    return Applied(effect, effect.pack(parameters), column)


class Recorder(Frozen):
    """An effect between the loop and the export. signals: which of SP, PV, OP it treats. lines: the historian joins the
    values at which the recorded signal changed by straight lines instead of holding them."""

    applied: Applied
    signals: tuple[str, ...] = ("PV", "OP")
    lines: bool = False


def draw_lines(original: FloatArray, held: FloatArray) -> FloatArray:
    """Join the samples that were reported by straight lines, as a historian interpolates.

    original, held: (samples,) before and after exception reporting. A sample was reported when the held value moved;
    the sample before it is reported too, as exception reporting does, so that a hold does not become a ramp."""
    moved = np.flatnonzero(np.diff(held) != 0.0) + 1
    points = np.unique(np.concatenate([[0], moved - 1, moved, [held.size - 1]]))
    return np.interp(np.arange(held.size), points, original[points])


class Signal(Frozen):
    """A signal from outside the loop: a constant level sent through effects (steps, drift, oscillation, random)."""

    level: float = 0.0
    effects: tuple[Applied, ...] = ()


class Manual(Frozen):
    """The operator holds the output from `start` to `end` [s], at `output` if given."""

    start: float
    end: float
    output: float | None = None


class Scenario(Frozen):
    """All that a simulation needs; seconds and normalised signals.

    The loop starts at rest: measurement at the setpoint's level, output at `output`. step: inner step [s].
    sample_time: of the controller, record_interval: of the export; both multiples of step, default step and
    sample_time. effects: of the loop; each sits at its own stage, in the order given. columns: further measured
    signals. recorder: what the historian does to recorded signals. seed: of every random effect. start: epoch seconds.
    pv_range, op_range: engineering values of 0 and 1 in a written file. hidden: settings the metadata leave out."""

    controller: Controller
    process: Process
    duration: float
    step: float
    effects: tuple[Applied, ...] = ()
    setpoint: Signal = field(default_factory=Signal)
    output: float = 0.0
    sample_time: float | None = None
    record_interval: float | None = None
    compensator: Compensator = field(default_factory=Compensator)
    manual: tuple[Manual, ...] = ()
    columns: Mapping[str, Signal] = field(default_factory=dict)
    recorder: tuple[Recorder, ...] = ()
    seed: int = 0
    name: str = "loop"
    start: float = 0.0
    pv_range: tuple[float, float] = (0.0, 1.0)
    op_range: tuple[float, float] = (0.0, 1.0)
    hidden: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in ("duration", "step"):
            if not 0.0 < getattr(self, name) <= self.duration < np.inf:
                raise MetadataError(f"{name} = {getattr(self, name):g} s is not possible", where=self.name,
                                    remedy="give seconds: duration above 0, step at most as long")
        if max(self.duration, self.process.dead_time) / self.step > 5e7:
            remedy = "shorten duration, or enlarge step"
            raise MetadataError("more than 50 million inner steps", where=self.name, remedy=remedy)
        if not max(abs(self.output), abs(self.setpoint.level)) < LARGEST:
            raise MetadataError(f"output {self.output:g} or setpoint level {self.setpoint.level:g} is not possible",
                                where=self.name, remedy="signals are normalised: 0..1 of their spans")
        if not all(-np.inf < low < high < np.inf for low, high in (self.pv_range, self.op_range)):
            raise MetadataError("ranges must be finite, and rise", where=self.name, remedy="low first: [0, 900]")
        if self.seed < 0:
            raise MetadataError(f"seed = {self.seed} is not possible", where=self.name, remedy="0, 1, 2, ...")
        if unknown := [h for h in self.hidden if h not in ("K", "Ti", "Td", "Tf", "Kp", "theta")]:
            raise MetadataError(f"'{unknown[0]}' cannot be hidden", where=self.name, remedy="K, Ti, Td, Tf, Kp, theta")
        every(self.sample_seconds, self.step, "sample_time")
        every(self.record_seconds, self.step, "record_interval")

    @property
    def sample_seconds(self) -> float:
        """Sample time of the controller [s]."""
        return self.step if self.sample_time is None else self.sample_time

    @property
    def record_seconds(self) -> float:
        """Interval of the record [s]."""
        return self.sample_seconds if self.record_interval is None else self.record_interval

    @property
    def settings(self) -> LoopSettings:
        """Settings as a historian's metadata would give them."""
        c = self.controller
        values = {"K": c.K, "Ti": c.Ti, "Td": c.Td, "Tf": c.filter_time, "Kp": self.process.static_gain,
                  "theta": self.process.dead_time or None}
        told = {name: value for name, value in values.items() if value is not None and name not in self.hidden}
        return LoopSettings(pv_range=self.pv_range, op_range=self.op_range).with_values("metadata", **told)


def every(time: float, step: float, name: str) -> int:
    """Return how many inner steps a time spans; MetadataError when it is not a whole number of them."""
    ratio = time / step
    count = round(ratio) if np.isfinite(ratio) else 0
    if count < 1 or abs(ratio - count) > 1e-6 * count:
        raise MetadataError(f"{name} = {time:g} s is not a multiple of step = {step:g} s", remedy=f"change {name}")
    return count


def truth_rows(scenarios: Iterable[Scenario]) -> list[Row]:
    """Return rows (loop, effect, parameter, value, unit), normalised; lists are joined by semicolons."""
    return [(s.name, effect, name, ";".join(v if isinstance(v, str) else f"{v:.10g}" for v in values), unit)
            for s in scenarios for effect, name, values, unit in _planted(s) if len(values)]


def _planted(s: Scenario) -> Iterator[tuple[str, str, Sequence[Any] | FloatArray, str]]:
    p, shaped = s.process, len(s.process.denominator) > 1
    yield "process", "gain", [p.gain], "PV span/OP span" + "/s" * p.integrating
    yield "process", "lags", p.lags, "s"
    yield "process", "numerator", p.numerator * shaped, "1"
    yield "process", "denominator", p.denominator * shaped, "1"
    yield "process", "dead_time", [p.dead_time], "s"
    yield "process", "integrating", [p.integrating], "0 or 1"
    placed = [("", s.effects), ("setpoint:", s.setpoint.effects), ("recorder:", [r.applied for r in s.recorder])]
    for place, applied in ((place, applied) for place, chain in placed for applied in chain):
        parameters, effect = applied.effect.parameters, place + applied.effect.name
        lists = sum(q.many for q in parameters)
        width = (len(applied.p) - len(parameters) + lists) // max(lists, 1)
        ends = np.cumsum([width if q.many else 1 for q in parameters])
        for q, own in zip(parameters, np.split(applied.p, ends[:-1]), strict=True):
            if not (q.nuisance or q.choices) or (own != q.neutral).any():
                # the same effect on a setpoint adds to the measurement's span
                yield effect, q.name, own, q.unit.replace("OP span", "PV span") if place == "setpoint:" else q.unit
        yield effect, "column", [] if applied.column is None else [applied.column], ""
    if s.compensator.gain > 0.0:
        yield "compensator", "gain", [s.compensator.gain], "span"
        yield "compensator", "scheme", [s.compensator.scheme], "equation"
