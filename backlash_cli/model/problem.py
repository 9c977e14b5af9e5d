"""One loop's recording as a model sees it: a gapless grid of OP and PV, with a mask of the samples that count."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..errors import LoopError
from ..record import FloatArray, LoopSettings, Record, SampleState

# fewer samples than this cannot carry a model with three parameters, a hold-out and a search
FEWEST_SAMPLES = 100


@dataclass(frozen=True, eq=False)
class Problem:
    """Uniform grid of one loop: all arrays (samples,), normalised, without nan.

    output: OP, held over holes. measurement: PV, 0 where `used` is False. recorded: PV with nan in holes.
    setpoint: SP, held over holes. columns: further measured columns, interpolated over holes.
    delay: dead time [s] known from the settings, None when the settings give none.
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

    @property
    def samples(self) -> int:
        """Grid points, holes included."""
        return len(self.output)

    @property
    def duration(self) -> float:
        """Length of the record [s]."""
        return self.samples * self.interval

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
        raise LoopError(
            f"only {count} usable samples; a model needs {FEWEST_SAMPLES}",
            where=where,
            remedy="export a longer period, or check the quality column",
            code="insufficient_data",
        )
    for name, values in (("OP", output[used]), ("PV", measurement[used])):
        if np.ptp(values) <= 1e-9 * max(1.0, float(np.max(np.abs(values)))):
            raise LoopError(
                f"{name} is constant ({values[0]:g} of span): nothing moves, so nothing can be learnt",
                where=where,
                remedy="export a period with setpoint changes or load upsets",
                code="constant_signal",
            )
    recorded = np.where(used, measurement, np.nan)
    held_output = _hold(output)
    first_bad = state == SampleState.IMPLAUSIBLE
    if np.any(first_bad):
        held_output = _hold(np.where(np.isfinite(output), output, np.nan))
    columns = {}
    for name, values in record.disturbances.items():
        grid = on_grid(values)
        if np.count_nonzero(np.isfinite(grid)) >= 0.5 * samples and np.nanstd(grid) > 0:
            columns[name] = _interpolate(grid)
    return Problem(
        loop=record.loop,
        interval=record.interval,
        output=held_output,
        measurement=np.where(used, measurement, 0.0),
        recorded=recorded,
        setpoint=_hold(on_grid(record.setpoint)),
        used=used,
        columns=columns,
        delay=record.settings.theta or None,
        settings=record.settings,
    )


def _hold(values: FloatArray) -> FloatArray:
    """Repeat the last number over holes; holes at the start take the first number."""
    good = np.isfinite(values)
    if not np.any(good):
        return np.zeros_like(values)
    last = np.maximum.accumulate(np.where(good, np.arange(len(values)), -1))
    last[last < 0] = int(np.argmax(good))
    out: FloatArray = values[last]
    return out


def _interpolate(values: FloatArray) -> FloatArray:
    good = np.flatnonzero(np.isfinite(values))
    return np.interp(np.arange(len(values)), good, values[good])
