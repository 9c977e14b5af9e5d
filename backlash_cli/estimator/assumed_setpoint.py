"""The setpoint of a record that has none: constant, where the controller's own law shows that it stood still.

Integral action holds the mean of PV at the setpoint. With that level in place of the setpoint, a PI or PID controller
of a loop whose setpoint never moved explains the recorded output almost to the last digit; where the setpoint moved,
it does not, and nothing is assumed.

    with_constant_setpoint(record) -> Record        the same record where a setpoint is there, or cannot be assumed
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..record import Note, Record
from .identify import LEAST_ROWS, identify

PROVEN = 0.98  # share of the output's motion that the law explains; with a moving setpoint 0.975 at most in 23 loops


def with_constant_setpoint(record: Record) -> Record:
    """Return the record with a constant setpoint where none was recorded and the output shows that it stood still."""
    output = record.output
    if output is None or not len(record) or np.isfinite(record.setpoint[0]) or np.isfinite(record.setpoint).any():
        return record
    held = at_mean(record)
    if held is None:
        return record
    found = identify(held)
    if isinstance(found, Note) or found.r2 < PROVEN:
        return record
    level = float(held.setpoint[0])
    low, high = record.settings.pv_range
    note = Note(
        "assumed_setpoint",
        f"no setpoint (SP) in the data; it is taken as constant at the mean of PV, {low + level * (high - low):.4g}: "
        f"with that a controller of K = {found.K.value:.3g} and Ti = {found.Ti.value:.3g} s explains "
        f"{100.0 * found.r2:.2f} % of the output's motion",
        {"setpoint": level, "r2": found.r2},
    )
    return replace(held, notes=(*(n for n in record.notes if n.code != "no_setpoint"), note))


def at_mean(record: Record) -> Record | None:
    """Return the record with the mean of PV as its setpoint, None with too few usable samples."""
    use = record.usable & np.isfinite(record.measurement)
    if record.output is not None:
        use &= np.isfinite(record.output)
    if np.count_nonzero(use) < LEAST_ROWS:
        return None
    return replace(record, setpoint=np.full(len(record), float(record.measurement[use].mean())))
