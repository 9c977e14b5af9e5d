"""One loop: its signals on one uniform grid, normalised, every sample with its state, everything assumed in notes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..errors import LoopError
from ..record import Note, Record
from .frame import Frame, fill_limit, grid_of
from .join import Joiner, LoopSeries
from .loop_settings import Settings
from .options import ReadOptions
from .samples import Counts, Samples
from .scaling import ArrayValues, normalised, spans_of
from .states import frozen


def build_record(loop: LoopSeries, settings: Settings, joiner: Joiner, options: ReadOptions) -> Record:
    """Make the Record of one loop. Raises LoopError when it has no measurement, no times or no usable scale."""
    refuse_missing(loop)
    pv = joiner.signal(loop.roles["pv"], "pv", loop.name)
    grid, pv = grid_of(pv)
    notes: list[Note] = [*settings.notes, *pv.axis.notes, *grid.notes, *pv.notes]
    frame = Frame(loop, joiner, options, pv.axis, grid, fill_limit(settings.loop.Ti, grid.interval), notes)
    measured, interpolated = frame.measurement(pv)
    if not any_number(measured):
        raise no_measurement()
    setpoint = frame.companion("sp")
    if setpoint is None and settings.constant_setpoint is not None:
        setpoint = np.full(len(measured), settings.constant_setpoint)
    output = frame.companion("op")
    if output is not None and not any_number(output):
        notes.append(NO_OUTPUT)
        output = None
    spans = spans_of(settings, ArrayValues(measured, setpoint), None if output is None else ArrayValues(output))
    notes += spans.notes
    sp_there = None if setpoint is None else normalised(setpoint, spans.pv_range)
    op_there = None if output is None else normalised(output, spans.op_range)
    manual, on_mode = frame.manual((*options.auto_modes, *settings.auto_modes))
    samples = Samples(grid.index, sp_there, normalised(measured, spans.pv_range), op_there, interpolated, manual,
                      frame.bridge, frozen)
    counts, total = samples.count(Counts()), len(measured)
    notes += [*counts.notes(total), *([] if setpoint is not None else [without_setpoint(loop.name)]),
              *counts.companion_notes(total), *on_mode, *counts.manual_notes(total)]
    extra = {name: frame.disturbance(items) for name, items in loop.extra.items()}
    measured_disturbances = {name: values for name, values in extra.items() if values is not None}
    return Record(
        loop.name, grid.start / 1e6, grid.interval, grid.index, samples.setpoint, samples.measurement,
        samples.output, samples.state, spans.settings, measured_disturbances, tuple(notes),
    )  # fmt: skip


NO_OUTPUT = Note("no_output", "the output (OP) holds no number at all")


def no_measurement() -> LoopError:
    """The error of a loop whose measurement holds nothing."""
    return LoopError("the measurement (PV) holds no number at all", code="no_measurement",
                     remedy="check the column and the export")


def any_number(values: NDArray[np.float64]) -> bool:
    """Is there a finite number?"""
    return bool(np.isfinite(values[:1]).any() or np.isfinite(values).any())


def refuse_missing(loop: LoopSeries) -> None:
    """Raise LoopError for a loop without a measurement, or without a tag that the loops file names."""
    for role, tag in loop.missing_tags.items():
        if role not in loop.roles:
            raise LoopError(
                f"{role} = {tag!r} from the metadata is not found in the data",
                code="tag_not_found",
                remedy=f"write the tag as it stands in the file, or leave {role} out",
            )
    if "pv" not in loop.roles:
        there = ", ".join(role.upper() for role in loop.roles)
        raise LoopError(
            f"no measurement (PV) column; there is {there} only",
            code="no_measurement",
            remedy=f'name the column {loop.name[:40]}.PV, or give pv = "TAG" in loops.toml',
        )


def without_setpoint(loop: str) -> Note:
    """Say that nothing recorded the setpoint."""
    text = "no setpoint (SP) column: what needs the control error cannot be done"
    return Note("no_setpoint", text, {"loop": loop})
