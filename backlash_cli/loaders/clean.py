"""One loop: its signals on one uniform grid, normalised, every sample with its state, everything assumed in notes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..errors import LoopError
from ..record import Note, Record, SampleState
from .expand import flags_on_grid, held, linear, on_grid, usual_spacing
from .grid import GAP_FACTOR, MAX_HOLE, SPARSE_SHARE, Grid
from .join import Joiner, LoopSeries, Signal
from .loop_settings import Settings
from .options import ReadOptions
from .quality import automatic
from .scaling import normalise, spans_of
from .states import frozen, hold_last, implausible, saturated, short_holes
from .times import NAT


def build_record(loop: LoopSeries, settings: Settings, joiner: Joiner, options: ReadOptions) -> Record:
    """Make the Record of one loop. Raises LoopError when it has no measurement, no times or no usable scale."""
    _refuse_missing(loop, options)
    notes: list[Note] = list(settings.notes)
    pv = joiner.signal(loop.roles["pv"], "pv", loop.name)
    grid, pv = _grid_of(pv)
    measured, bad = _measurement(pv, grid, options)
    notes += [*pv.axis.notes, *grid.notes, *pv.notes]
    if not np.isfinite(measured).any():
        raise LoopError(
            "the measurement (PV) holds no number at all",
            code="no_measurement",
            remedy="check the column and the export",
        )
    setpoint = _companion(loop, "sp", pv.axis, grid, joiner, options, notes)
    if setpoint is None and settings.constant_setpoint is not None:
        setpoint = np.full(len(measured), settings.constant_setpoint)
    output = _companion(loop, "op", pv.axis, grid, joiner, options, notes)
    if output is not None and not np.isfinite(output).any():
        notes.append(Note("no_output", "the output (OP) holds no number at all"))
        output = None
    spans = spans_of(settings, measured, setpoint, output)
    notes += spans.notes
    y = normalise(measured, spans.pv_range)
    u = None if output is None else normalise(output, spans.op_range)
    state, y = _states(y, bad, u, grid, settings, notes)
    if setpoint is None:
        notes.append(
            Note(
                "no_setpoint",
                "no setpoint (SP) column: what needs the control error cannot be done",
                {"loop": loop.name},
            )
        )
        r = np.full(len(y), np.nan)
    else:
        r = normalise(setpoint, spans.pv_range)
        _mark(state, ~np.isfinite(r), SampleState.MISSING, "setpoint_missing", "have no setpoint", notes)
    if u is not None:
        lost = ~np.isfinite(u)
        _mark(state, lost, SampleState.MISSING, "output_missing", "have no output", notes)
    manual = _manual(loop, pv.axis, grid, joiner, settings, options, notes)
    if manual is not None:
        chosen = manual & (state != SampleState.MISSING) & (state != SampleState.IMPLAUSIBLE)
        _mark(state, chosen, SampleState.MANUAL, "manual", "are not in automatic", notes)
    extra = {name: _extra(items, pv.axis, grid, joiner, options) for name, items in loop.extra.items()}
    return Record(
        loop.name,
        grid.start / 1e6,
        grid.interval,
        grid.index,
        r,
        y,
        u,
        state,
        spans.settings,
        {name: values for name, values in extra.items() if values is not None},
        tuple(notes),
    )


def _refuse_missing(loop: LoopSeries, options: ReadOptions) -> None:
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


def _grid_of(pv: Signal) -> tuple[Grid, Signal]:
    """The grid is that of the measurement; blank cells in many places mean that it was recorded less often."""
    blank = np.isnan(pv.values) if pv.bad is None else np.isnan(pv.values) & ~pv.bad
    count = int(blank.sum())
    if count and count < len(blank):
        known = pv.axis.micros != NAT
        edges = int(np.count_nonzero(blank[1:] & ~blank[:-1] & known[1:]))
        if edges > SPARSE_SHARE * (len(blank) - count) or count > 0.9 * len(blank):
            rows = np.flatnonzero(~blank)
            pv = replace(
                pv, axis=pv.axis.take(rows), values=pv.values[rows], bad=None if pv.bad is None else pv.bad[rows]
            )
    return pv.axis.grid(pv.values), pv


def _measurement(pv: Signal, grid: Grid, options: ReadOptions) -> tuple[NDArray[np.float64], NDArray[np.bool_] | None]:
    """Return (values on the grid, samples that were interpolated between records)."""
    if grid.kind == "regular":
        return on_grid(pv.values, grid), None
    limit = GAP_FACTOR * usual_spacing(pv) if grid.kind == "compressed" else (MAX_HOLE + 1.5) * grid.step
    limit = max(limit, (MAX_HOLE + 1.5) * grid.step)
    if options.interpolation == "hold":
        values = held(pv, grid, limit)
    else:
        values = linear(pv, grid, limit)
    assert grid.recorded is not None
    return values, ~grid.recorded & np.isfinite(values)


def _companion(
    loop: LoopSeries, role: str, axis: object, grid: Grid, joiner: Joiner, options: ReadOptions, notes: list[Note]
) -> NDArray[np.float64] | None:
    """Setpoint or output on the grid of the measurement: held between its records unless the user says linear."""
    if role not in loop.roles:
        return None
    signal = joiner.signal(loop.roles[role], role, loop.name)
    notes += signal.notes
    return _expanded(signal, role, axis, grid, options, notes)


def _expanded(
    signal: Signal, role: str, axis: object, grid: Grid, options: ReadOptions, notes: list[Note] | None
) -> NDArray[np.float64]:
    if signal.axis is axis and grid.kind == "regular":
        values = on_grid(signal.values, grid)
        if not np.isnan(np.add.reduce(values)):
            return values
        if signal.bad is None and np.count_nonzero(np.isnan(values)) < SPARSE_SHARE * len(values) and role != "sp":
            return _bridged(values, grid, MAX_HOLE)
    linearly = options.interpolation == "linear" and role != "mode"
    limit = None if role in ("sp", "mode") else max(GAP_FACTOR * usual_spacing(signal), (MAX_HOLE + 1.5) * grid.step)
    if notes is not None and signal.axis is not axis and role in ("sp", "op"):
        how = "interpolated on straight lines" if linearly else "held until the next record"
        notes.append(Note("expanded", f"{role.upper()} is recorded at its own times; it is {how}"))
    if linearly:
        return linear(signal, grid, float("inf") if limit is None else limit)
    return held(signal, grid, limit)


def _bridged(values: NDArray[np.float64], grid: Grid, longest: int) -> NDArray[np.float64]:
    held_values = hold_last(values, longest)
    if len(grid.index) and grid.index[-1] - grid.index[0] != len(grid.index) - 1:
        # nothing is held across a gap
        first = np.flatnonzero(np.diff(grid.index) > 1) + 1
        for position in first[np.isnan(values[first])]:
            end = position
            while end < len(values) and np.isnan(values[end]):
                held_values[end] = np.nan
                end += 1
    return held_values


def _states(
    y: NDArray[np.float64],
    interpolated: NDArray[np.bool_] | None,
    u: NDArray[np.float64] | None,
    grid: Grid,
    settings: Settings,
    notes: list[Note],
) -> tuple[NDArray[np.uint8], NDArray[np.float64]]:
    state = np.zeros(len(y), np.uint8)
    wild = implausible(y)
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
    lost = np.isnan(np.add.reduce(y))
    if lost:
        y, filled = short_holes(y, grid.index, fill_limit(settings.loop.Ti, grid.interval))
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
    if u is not None:
        limit = saturated(u)
        if limit is not None:
            _mark(state, limit, SampleState.SATURATED, "saturated", "have the output at its limit", notes)
    if lost:
        missing = ~np.isfinite(y)
        if wild is not None:
            state[missing & wild] = SampleState.IMPLAUSIBLE
            missing &= ~wild
        _mark(state, missing, SampleState.MISSING, "missing", "have no measurement", notes)
    return state, y


def fill_limit(Ti: float | None, interval: float) -> int:
    """Longest hole in samples that is filled: MAX_HOLE, and not longer than a fifth of the integral time."""
    if Ti is None:
        return MAX_HOLE
    return int(min(MAX_HOLE, max(1, Ti / 5.0 / interval)))


def _mark(
    state: NDArray[np.uint8], where: NDArray[np.bool_], value: SampleState, code: str, what: str, notes: list[Note]
) -> None:
    count = int(np.count_nonzero(where))
    if count:
        state[where] = value
        notes.append(Note(code, f"{count} of {len(state)} samples {what}; not used", {"samples": float(count)}))


def _manual(
    loop: LoopSeries,
    axis: object,
    grid: Grid,
    joiner: Joiner,
    settings: Settings,
    options: ReadOptions,
    notes: list[Note],
) -> NDArray[np.bool_] | None:
    """(samples,) True where the controller was not in automatic; None when no mode is recorded."""
    if "mode" not in loop.roles:
        return None
    parts = []
    for item in loop.roles["mode"]:
        values, more = automatic(item.cells, (*options.auto_modes, *settings.auto_modes))
        notes += more
        parts.append((item.axis, values))
    signal = Signal(joiner.axis([a for a, _ in parts]), np.concatenate([v for _, v in parts]), None)
    if not np.isfinite(signal.values).any():
        notes.append(Note("mode_empty", "the MODE column is empty; the loop is taken to be in automatic"))
        return None
    values = _expanded(signal, "mode", axis, grid, options, None)
    unknown = np.isnan(values)
    if unknown.any():
        # before the first record: a first change to manual means automatic before, and the other way round
        first = values[np.flatnonzero(~unknown)[0]] if not unknown.all() else 0.0
        leads_manual = bool(first == 0.0 and not unknown.all())
        values = np.where(unknown, 1.0 if leads_manual else 0.0, values)
        word = "automatic" if leads_manual else "not automatic"
        notes.append(
            Note("mode_unknown", f"{int(unknown.sum())} samples before the first recorded mode are taken as {word}")
        )
    return values == 0.0


def _extra(items: list, axis: object, grid: Grid, joiner: Joiner, options: ReadOptions) -> NDArray[np.float64] | None:
    """A further measured column on the grid, in its own units; None when it holds no numbers or cannot be joined."""
    try:
        signal = joiner.signal(items[:1] if items[0].axis is axis else items, "", "")
    except LoopError:
        return None
    if not np.isfinite(signal.values).any():
        return None
    return _expanded(signal, "dv", axis, grid, options, None)


def flagged(signal: Signal, grid: Grid) -> NDArray[np.bool_] | None:
    """Bad cells of a regular grid's own rows."""
    return None if signal.bad is None else flags_on_grid(signal.bad, grid)
