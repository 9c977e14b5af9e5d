"""What a simulation needs to know: controller, process, effects, setpoint, load, recorder."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..errors import MetadataError
from ..record import LoopSettings
from .applied import Applied
from .controller import Compensator, Controller
from .process import Process
from .recorder import Recorder

# a signal at rest further out than this many spans is an engineering value, not a normalised one
LARGEST = 10.0


@dataclass(frozen=True)
class Signal:
    """A signal from outside the loop: a constant level sent through effects (steps, drift, oscillation, random)."""

    level: float = 0.0
    effects: tuple[Applied, ...] = ()


@dataclass(frozen=True)
class Manual:
    """The operator holds the output from `start` to `end` [s], at `output` if given."""

    start: float
    end: float
    output: float | None = None


@dataclass(frozen=True)
class Scenario:
    """All that a simulation needs; seconds and normalised signals.

    The loop starts at rest: measurement at the setpoint's level, output at `output`. step: inner step [s].
    sample_time: of the controller, record_interval: of the export; both multiples of step, default step and
    sample_time. effects: of the loop; each sits at its own stage, in the order given. columns: further measured
    signals. recorder: what the historian does to recorded signals. seed: of every random effect. start: epoch
    seconds. pv_range, op_range: engineering values of 0 and 1 in a written file. hidden: settings, such as Kp, that
    the metadata keep to themselves.
    """

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
            if not 0.0 < getattr(self, name) < np.inf:
                raise MetadataError(f"{name} = {getattr(self, name):g} s is not possible", where=self.name)
        if max(self.duration, self.process.dead_time) / self.step > 5e7:
            raise MetadataError("more than 50 million inner steps", where=self.name, remedy="enlarge step")
        if not max(abs(self.output), abs(self.setpoint.level)) < LARGEST:
            raise MetadataError(
                f"output {self.output:g} or setpoint level {self.setpoint.level:g} is not possible",
                where=self.name,
                remedy="signals are normalised: 0..1 of their spans",
            )
        if not np.isfinite([*self.pv_range, *self.op_range]).all():
            raise MetadataError("ranges must be finite", where=self.name)
        if self.seed < 0:
            raise MetadataError(f"seed = {self.seed} is not possible", where=self.name, remedy="0, 1, 2, ...")
        unknown = [h for h in self.hidden if h not in ("K", "Ti", "Td", "Tf", "Kp", "theta")]
        if unknown:
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
        values: dict[str, Any] = {"K": c.K, "Ti": c.Ti, "Td": c.Td, "Tf": c.filter_time}
        if self.process.static_gain is not None:
            values["Kp"] = self.process.static_gain
        if self.process.dead_time > 0.0:
            values["theta"] = self.process.dead_time
        told = {k: v for k, v in values.items() if k not in self.hidden}
        return LoopSettings(pv_range=self.pv_range, op_range=self.op_range).with_values("metadata", **told)


def every(time: float, step: float, name: str) -> int:
    """Return how many inner steps a time spans; MetadataError when it is not a whole number of them."""
    ratio = time / step
    count = round(ratio) if np.isfinite(ratio) else 0
    if count < 1 or abs(ratio - count) > 1e-6 * count:
        raise MetadataError(f"{name} = {time:g} s is not a multiple of step = {step:g} s", remedy=f"change {name}")
    return count
