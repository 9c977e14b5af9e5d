"""The controller output rebuilt from SP, PV, K and Ti where it was not recorded."""

import numpy as np
from numpy.typing import NDArray

from ..half_periods import DoubleLag, double_lag
from ..record import FloatArray, LoopSettings, Record


def rebuilt_output(record: Record, settings: LoopSettings, usable: NDArray[np.bool_]) -> FloatArray:
    """Return u = K (-yf + 1/Ti integral(ysp - yf) - Td dyf/dt), but for a constant, (samples,); nan where not usable.

    A digital controller acts at once on the PV that it reads, and the two are recorded together. The constant is
    unknown and does not matter to a dead band. After a hole in the record the integral goes on from where it was.
    Source: Haegglund (2007), eqs 2 and 3. K and Ti must be known.
    """
    assert settings.K and settings.Ti
    out, at = np.full(len(record), np.nan), np.flatnonzero(usable)
    if len(at):
        y = record.measurement[at]
        lag = at_once(double_lag(settings.filter_time or 0.0, record.interval))
        yf, _ = lag.run(y, lag.settled(float(y[0])))
        integral = np.cumsum(record.setpoint[at] - yf) * record.interval / settings.Ti
        out[at] = settings.K * (integral - yf - settings.Td * np.diff(yf, prepend=y[0]) / record.interval)
    return out


def at_once(lag: DoubleLag) -> DoubleLag:
    """Return the filter that has made of each sample what `lag` makes of it until the next one comes.

    In simulated loops the rebuilt output is off by a fifth to a hundredth of what it is off with `lag`; where PV is
    recorded much less often than the controller reads it, by as much.
    """
    if lag.numerator[0] != 0.0:  # no filter
        return lag
    return DoubleLag(np.append(lag.numerator[1:], 0.0), lag.denominator)
