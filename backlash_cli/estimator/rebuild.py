"""The controller output by the law of the controller where it was not recorded, or between records far apart."""

import numpy as np
from numpy.typing import NDArray

from ..half_periods import double_lag
from ..record import FloatArray, LoopSettings, Record

RARE = 0.25  # of Ti from one record of OP to the next, on average; held in between it comes late from there on
LED, FEWEST_RECORDS = 0.3, 5  # of what OP changes from record to record the law may miss so much; told by so many


def output_made(record: Record, settings: LoopSettings) -> tuple[FloatArray | None, str]:
    """Return OP (samples,) as the controller made it, None where it is not to be had, and whence it comes.

    recorded: as it stands there. completed: from record to record on the course of the law, what that misses spread
    evenly, where a historian kept few values and the law, with the weight of the setpoint that fits best, leads from
    one to the next. rebuilt: none was recorded. Without K and Ti there is only what was recorded."""
    output, known = record.output, record.usable & np.isfinite(record.measurement) & np.isfinite(record.setpoint)
    if not (settings.K and settings.Ti):
        return output, "recorded"
    if output is None:
        return rebuilt_output(record, settings, known), "rebuilt"
    at = np.flatnonzero(known & np.isfinite(output))
    own = at[np.diff(output[at], prepend=np.nan) != 0.0]
    if FEWEST_RECORDS <= len(own) <= len(at) / max(RARE * settings.Ti / record.interval, 2.0):
        law = rebuilt_output(record, settings, known)
        missed, moves = output[own] - law[own], np.diff(record.setpoint[own])
        weight = np.diff(missed) @ moves / max(moves @ moves, 1e-300)  # of the setpoint in the proportional part
        law, missed = law + weight * record.setpoint, missed - weight * record.setpoint[own]
        if np.std(np.diff(missed)) <= LED * np.std(np.diff(output[own])):
            return np.where(known, law + np.interp(np.arange(len(law)), own, missed), output), "completed"
    return output, "recorded"


def rebuilt_output(record: Record, settings: LoopSettings, usable: NDArray[np.bool_]) -> FloatArray:
    """Return u = K (-yf + 1/Ti integral(ysp - yf) - Td dyf/dt), but for a constant, (samples,); nan where not usable.

    A digital controller acts at once on the PV that it reads, and the two are recorded together. The constant is
    unknown and does not matter to a dead band. After a hole in the record the integral goes on from where it was.
    Source: Haegglund (2007), eqs 2 and 3. K and Ti must be known."""
    assert settings.K and settings.Ti
    out, at = np.full(len(record), np.nan), np.flatnonzero(usable)
    if len(at):
        y = record.measurement[at]
        lag = double_lag(settings.filter_time or 0.0, record.interval)
        # what it makes of each sample until the next one comes; a sample late, OP would be off by five times as much
        yf = lag.run(np.append(y, y[-1]), lag.settled(float(y[0])))[0][1 if settings.filter_time else 0 :][: len(y)]
        integral = np.cumsum(record.setpoint[at] - yf) * record.interval / settings.Ti
        out[at] = settings.K * (integral - yf - settings.Td * np.diff(yf, prepend=y[0]) / record.interval)
    return out

