"""The controller output rebuilt from SP, PV, K and Ti where it was not recorded."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..half_periods import DoubleLag, double_lag
from ..record import FloatArray, LoopSettings, Record


class OutputRebuilder:
    """u = K (-yf + 1/Ti integral(ysp - yf) - Td dyf/dt), but for a constant (Haegglund 2007, eqs 2 and 3).

    A digital controller acts at once on the PV that it reads, and the two are recorded together. The constant is
    unknown and does not matter to a dead band. After a hole in the record the integral goes on from
    where it was.
    """

    def __init__(self, settings: LoopSettings, interval: float) -> None:
        assert settings.K and settings.Ti
        self.settings, self.interval = settings, interval
        self._filter = at_once(double_lag(settings.filter_time or 0.0, interval))
        self._state: FloatArray | None = None
        self._integral = 0.0
        self._last = 0.0

    def update(self, block: Record, usable: NDArray[np.bool_]) -> FloatArray:
        """Return the output (samples,), nan where the sample is not usable."""
        out = np.full(len(block), np.nan)
        at = np.flatnonzero(usable)
        if not len(at):
            return out
        y, r = block.measurement[at], block.setpoint[at]
        if self._state is None:
            self._state, self._last = self._filter.settled(float(y[0])), float(y[0])
        yf, self._state = self._filter.run(y, self._state)
        K, Ti, h = float(self.settings.K or 0.0), float(self.settings.Ti or 1.0), self.interval
        integral = self._integral + np.cumsum(r - yf) * h / Ti
        self._integral = float(integral[-1])
        slope = np.diff(yf, prepend=self._last) / h
        self._last = float(yf[-1])
        out[at] = K * (integral - yf - self.settings.Td * slope)
        return out


def at_once(lag: DoubleLag) -> DoubleLag:
    """Return the filter that has made of each sample what `lag` makes of it until the next one comes.

    In simulated loops the rebuilt output is off by a fifth to a hundredth of what it is off with `lag`; where PV is
    recorded much less often than the controller reads it, by as much.
    """
    if lag.numerator[0] != 0.0:  # no filter
        return lag
    return DoubleLag(np.append(lag.numerator[1:], 0.0), lag.denominator)
