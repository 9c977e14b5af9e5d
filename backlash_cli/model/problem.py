"""One loop's recording as a model sees it: a gapless grid of OP and PV, with a mask of the samples that count."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import LoopError
from ..record import FloatArray, LoopSettings, Record, SampleState
from .output import MOSTLY, between_steps, horizon, moved_from_outside, step_of

# fewer samples than this cannot carry a model with three parameters, a hold-out and a search
FEWEST_SAMPLES = 100


# holes of OP that get a free mean; the others are bridged by a straight line
MOST_HOLES = 12


@dataclass(frozen=True)
class Hole:
    """Samples first..last-1 without OP; `doubt` is how far the mean of OP may lie off a straight line [span]."""

    first: int
    last: int
    doubt: float


@dataclass(frozen=True, eq=False)
class Problem:
    """Uniform grid of one loop: all arrays (samples,), normalised, without nan.

    output: OP, straight lines over holes. measurement: PV, 0 where `used` is False. recorded: PV with nan in holes.
    setpoint: SP, held over holes. columns: means of further measured columns up to the next sample, holes interpolated.
    delay: dead time [s] known from the settings, None when the settings give none. holes: where OP is not known.
    floor: standard deviation of the measurement noise [span], from third differences. memory, moved, others: load
    columns, moved outputs and the columns of the last shape, shared by problems that differ in their mask only.
    driven: share of OP's motion that comes from the setpoint or the operator. output_step: in which OP was recorded
    [span], 0 when it hardly matters.
    ahead: samples that a loop driven by its load is predicted ahead (see `output`).
    """

    loop: str
    interval: float
    output: FloatArray
    measurement: FloatArray
    recorded: FloatArray
    setpoint: FloatArray
    used: NDArray[np.bool_]
    columns: Mapping[str, FloatArray]
    delay: float | None
    settings: LoopSettings
    holes: tuple[Hole, ...] = ()
    floor: float = 1e-4
    driven: float = 1.0
    ahead: int = 1
    output_step: float = 0.0
    memory: dict[object, list[FloatArray]] = field(default_factory=dict, repr=False)
    moved: dict[object, FloatArray] = field(default_factory=dict, repr=False)
    others: dict[str, Any] = field(default_factory=dict, repr=False)

    @property
    def samples(self) -> int:
        """Grid points, holes included."""
        return len(self.output)

    @property
    def duration(self) -> float:
        """Length of the record [s]."""
        return self.samples * self.interval

    @property
    def by_load(self) -> bool:
        """True where OP answers to the load: PV is then predicted a short time ahead, not from OP alone."""
        return self.driven < MOSTLY

    def masked(self, keep: NDArray[np.bool_]) -> Problem:
        """Return the problem with only the samples `keep` (samples,) counting."""
        return replace(self, used=self.used & keep)

    def with_measurement(self, measurement: FloatArray, used: NDArray[np.bool_]) -> Problem:
        """Return the problem with another measurement (samples,) and other samples that count."""
        return replace(self, measurement=np.where(used, measurement, 0.0), used=used)


def problem_from_record(record: Record) -> Problem:
    """Lay a record on its grid for a model.

    Raises LoopError when OP is absent or constant, PV is constant, or too few samples can be used.
    """
    where = record.loop
    if record.output is None:
        raise LoopError(
            "no controller output (OP): the model predicts PV from OP",
            where=where,
            remedy="export the OP column too, or name it with op = '...' in loops.toml",
            code="no_output",
        )
    if len(record) == 0:
        raise LoopError("no samples", where=where, remedy="export a longer period", code="insufficient_data")
    index = record.index - record.index[0]
    samples = int(index[-1]) + 1

    def on_grid(values: FloatArray) -> FloatArray:
        out = np.full(samples, np.nan)
        out[index] = values
        return out

    state = np.full(samples, SampleState.MISSING, dtype=np.uint8)
    state[index] = record.state
    measurement, output = on_grid(record.measurement), on_grid(record.output)
    # PV is predicted from OP whoever moves OP: manual periods and OP at a limit tell as much as automatic ones
    whole = np.isin(state, (SampleState.GOOD, SampleState.MANUAL, SampleState.SATURATED))
    used = whole & np.isfinite(measurement) & np.isfinite(output)
    count = int(np.count_nonzero(used))
    if count < FEWEST_SAMPLES:
        # a signal that never moves is marked frozen as a whole: that is the reason to give, not its consequence
        _refuse_constant(where, output, measurement)
        raise LoopError(
            f"only {count} usable samples; a model needs {FEWEST_SAMPLES}",
            where=where,
            remedy="export a longer period, or check the quality column and the span (pv_range)",
            code="insufficient_data",
        )
    _refuse_constant(where, output[used], measurement[used])
    recorded = np.where(used, measurement, np.nan)
    columns = {}
    for name, values in record.disturbances.items():
        grid = on_grid(values)
        if np.count_nonzero(np.isfinite(grid)) >= 0.5 * samples and np.nanstd(grid) > 0:
            columns[name] = _until_next(_interpolate(grid))
    moved, setpoint, floor = _interpolate(output), hold(on_grid(record.setpoint)), noise_floor(recorded)
    return Problem(
        loop=record.loop,
        interval=record.interval,
        output=moved,
        measurement=np.where(used, measurement, 0.0),
        recorded=recorded,
        setpoint=setpoint,
        used=used,
        columns=columns,
        delay=record.settings.theta or None,
        settings=record.settings,
        holes=_holes(output),
        floor=floor,
        driven=moved_from_outside(moved, setpoint, state == SampleState.MANUAL, used, record.interval),
        output_step=step_of(moved),
        ahead=horizon(recorded, floor, record.interval, record.settings.Ti),
    )


def _refuse_constant(where: str, output: FloatArray, measurement: FloatArray) -> None:
    """Raise LoopError when OP or PV (samples,) holds one value only; nan is left out."""
    for name, values in (("OP", output[np.isfinite(output)]), ("PV", measurement[np.isfinite(measurement)])):
        if values.size and np.ptp(values) <= 1e-9 * max(1.0, float(np.max(np.abs(values)))):
            raise LoopError(
                f"{name} is constant ({100 * values[0]:.3g} % of span): nothing moves, so nothing can be learnt",
                where=where,
                remedy="export a period with setpoint changes or load upsets",
                code="constant_signal",
            )


def finer(problem: Problem) -> Problem | None:
    """Return the problem with OP as it may have been before rounding, None when OP was not rounded coarsely."""
    if not problem.output_step:
        return None
    return replace(problem, output=between_steps(problem.output, problem.output_step), memory={}, moved={}, others={})


def usual_output(problem: Problem) -> tuple[float, float] | None:
    """Return the range in which OP [span] was for all but one sample in fifty; None where it hardly moved."""
    low, high = np.quantile(problem.output[problem.used], [0.01, 0.99])
    return (float(low), float(high)) if high > low + 1e-6 else None


def noise_floor(recorded: FloatArray) -> float:
    """Return the standard deviation of white measurement noise in PV (samples,), nan in holes.

    Third differences take away all that moves slowly: sqrt(mean(d3^2) / 20).
    """
    third = np.diff(recorded, 3)
    third = third[np.isfinite(third)]
    if third.size == 0:
        return 1e-4
    squares = np.sort(third**2)
    # a kink of the process, such as the start of an answer to a step, is no noise: the largest 5 % are left out, and
    # what a normal distribution has there is put back (mean square within 1.96 deviations: 0.759)
    inner = float(np.mean(squares[: max(int(0.95 * squares.size), 1)])) / 0.759
    return max(float(np.sqrt(min(inner, float(np.mean(squares))) / 20.0)), 1e-7)


def _holes(output: FloatArray) -> tuple[Hole, ...]:
    """Return the holes of OP of two samples or more, at most MOST_HOLES, those with the largest doubt."""
    edge = np.diff(np.concatenate([[0], (~np.isfinite(output)).astype(np.int8), [0]]))
    sums = np.concatenate([[0.0], np.cumsum(_interpolate(output))])
    found = []
    for a, b in zip(np.flatnonzero(edge == 1), np.flatnonzero(edge == -1), strict=True):
        length = int(b - a)
        if length < 2 or a == 0 or b == len(output):
            continue
        # what stretches of the same length elsewhere did, and half of the move from one side to the other
        ends = 0.5 * (output[: -length - 1] + output[length + 1 :])
        wiggle = np.abs((sums[length + 1 : -1] - sums[1 : -length - 1]) / length - ends)
        doubt = 1.5 * float(np.nanmedian(wiggle)) + 0.5 * float(abs(output[b] - output[a - 1]))
        found.append(Hole(int(a), int(b), max(doubt, 1e-6)))
    found.sort(key=lambda hole: (-hole.doubt, hole.first))
    return tuple(found[:MOST_HOLES])


def hold(values: FloatArray) -> FloatArray:
    """Repeat the last number over holes; holes at the start take the first number."""
    good = np.isfinite(values)
    if not np.any(good):
        return np.zeros_like(values)
    last = np.maximum.accumulate(np.where(good, np.arange(len(values)), -1))
    last[last < 0] = int(np.argmax(good))
    out: FloatArray = values[last]
    return out


def _until_next(values: FloatArray) -> FloatArray:
    """Return the mean of a signal (samples,) from each sample to the next: unlike OP it moves on between scans."""
    return 0.5 * (values + np.append(values[1:], values[-1]))


def _interpolate(values: FloatArray) -> FloatArray:
    good = np.flatnonzero(np.isfinite(values))
    return np.interp(np.arange(len(values)), good, values[good])
