"""One loop: its signals on one uniform grid, normalised, every sample with its state, everything assumed in notes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..errors import LoopError
from ..record import Note, Record, SampleState
from .frame import Frame, fill_limit, grid_of
from .join import Joiner, LoopSeries
from .loop_settings import Settings
from .options import ReadOptions
from .scaling import Normalised, normalised, spans_of
from .states import AT_LIMIT, BEYOND, frozen, implausible, saturated, short_holes


def build_record(loop: LoopSeries, settings: Settings, joiner: Joiner, options: ReadOptions) -> Record:
    """Make the Record of one loop. Raises LoopError when it has no measurement, no times or no usable scale."""
    _refuse_missing(loop)
    pv = joiner.signal(loop.roles["pv"], "pv", loop.name)
    grid, pv = grid_of(pv)
    notes: list[Note] = [*settings.notes, *pv.axis.notes, *grid.notes, *pv.notes]
    frame = Frame(loop, joiner, options, pv.axis, grid, fill_limit(settings.loop.Ti, grid.interval), notes)
    measured, interpolated = frame.measurement(pv)
    if not _any_number(measured):
        raise LoopError(
            "the measurement (PV) holds no number at all",
            code="no_measurement",
            remedy="check the column and the export",
        )
    setpoint = frame.companion("sp")
    if setpoint is None and settings.constant_setpoint is not None:
        setpoint = np.full(len(measured), settings.constant_setpoint)
    output = frame.companion("op")
    if output is not None and not _any_number(output):
        notes.append(Note("no_output", "the output (OP) holds no number at all"))
        output = None
    spans = spans_of(settings, measured, setpoint, output)
    notes += spans.notes
    pv_there = normalised(measured, spans.pv_range)
    op_there = None if output is None else normalised(output, spans.op_range)
    state, y = _states(pv_there, interpolated, op_there, frame)
    u = None if op_there is None else op_there.values
    if setpoint is None:
        text = "no setpoint (SP) column: what needs the control error cannot be done"
        notes.append(Note("no_setpoint", text, {"loop": loop.name}))
        r = np.full(len(y), np.nan)
    else:
        sp_there = normalised(setpoint, spans.pv_range)
        r = sp_there.values
        if not sp_there.complete:
            _mark(state, ~np.isfinite(r), SampleState.MISSING, "setpoint_missing", "have no setpoint", notes)
    if op_there is not None and not op_there.complete:
        _mark(state, ~np.isfinite(op_there.values), SampleState.MISSING, "output_missing", "have no output", notes)
    manual = frame.manual((*options.auto_modes, *settings.auto_modes))
    if manual is not None:
        chosen = manual & (state != SampleState.MISSING) & (state != SampleState.IMPLAUSIBLE)
        _mark(state, chosen, SampleState.MANUAL, "manual", "are not in automatic", notes)
    extra = {name: frame.disturbance(items) for name, items in loop.extra.items()}
    measured_disturbances = {name: values for name, values in extra.items() if values is not None}
    return Record(
        loop.name, grid.start / 1e6, grid.interval, grid.index, r, y, u, state, spans.settings, measured_disturbances,
        tuple(notes),
    )  # fmt: skip


def _any_number(values: NDArray[np.float64]) -> bool:
    return bool(np.isfinite(values[:1]).any() or np.isfinite(values).any())


def _refuse_missing(loop: LoopSeries) -> None:
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


def _states(
    pv: Normalised, interpolated: NDArray[np.bool_] | None, op: Normalised | None, frame: Frame
) -> tuple[NDArray[np.uint8], NDArray[np.float64]]:
    notes = frame.notes
    y = pv.values
    state = np.zeros(len(y), np.uint8)
    near = pv.complete and pv.low >= -BEYOND and pv.high <= 1.0 + BEYOND
    wild = None if near else implausible(y)
    if wild is not None:
        y = np.where(wild, np.nan, y)
        count = int(wild.sum())
        if count > 0.5 * len(y):
            notes.append(
                Note(
                    "outside_range",
                    f"{100 * count / len(y):.0f} % of the measurement lies far outside pv_range: check it",
                )
            )
        else:
            notes.append(
                Note(
                    "implausible",
                    f"{count} samples of PV far outside the range (spikes) were rejected",
                    {"samples": float(count)},
                )
            )
    lost = not pv.complete or wild is not None
    if lost:
        y, filled = short_holes(y, frame.grid.index, frame.bridge)
        if filled.any():
            state[filled] = SampleState.FILLED
            notes.append(
                Note(
                    "filled",
                    f"{int(filled.sum())} samples in short holes were interpolated",
                    {"samples": float(filled.sum())},
                )
            )
    if interpolated is not None:
        state[interpolated] = SampleState.FILLED
    still = frozen(y)
    if still is not None:
        _mark(
            state, still, SampleState.FROZEN, "frozen", "repeat one number for too long (PV constant or frozen)", notes
        )
    if op is not None and not (op.complete and op.low > AT_LIMIT and op.high < 1.0 - AT_LIMIT):
        limit = saturated(op.values)
        if limit is not None:
            state[limit] = SampleState.SATURATED
            notes.append(marked(SampleState.SATURATED, int(np.count_nonzero(limit)), len(state)))
    if lost:
        missing = ~np.isfinite(y)
        if wild is not None:
            state[missing & wild] = SampleState.IMPLAUSIBLE
            missing &= ~wild
        _mark(state, missing, SampleState.MISSING, "missing", "have no measurement", notes)
    return state, y


def marked(value: SampleState, count: int, samples: int) -> Note:
    """The note of samples that are not used."""
    code, what = _MARKED[value]
    return Note(code, f"{count} of {samples} samples {what}; not used", {"samples": float(count)})


_MARKED = {SampleState.SATURATED: ("saturated", "have the output at its limit")}


def _mark(
    state: NDArray[np.uint8], where: NDArray[np.bool_], value: SampleState, code: str, what: str, notes: list[Note]
) -> None:
    count = int(np.count_nonzero(where))
    if count:
        state[where] = value
        notes.append(Note(code, f"{count} of {len(state)} samples {what}; not used", {"samples": float(count)}))
