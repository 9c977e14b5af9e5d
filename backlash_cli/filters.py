"""Second-order low-pass filters in exact discrete form, with the state carried from block to block.

Both filters of the method are Y_f(s) = Y(s) / (1 + s T)^2: the measurement filter (3) with T = Tf and the
estimator's own with T = Ti/2 (Haegglund 2007, eq. 3 and section 4). The sampled signal is held between samples, so
the discretisation below is exact for it, at any ratio of sampling interval to time constant.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numba
import numpy as np

from .record import FloatArray


@numba.njit(cache=True)
def _filter(b: Any, a: Any, values: Any, z: Any) -> Any:
    """Second-order filter in direct form II transposed, changing the state z in place.

    The same as scipy.signal.lfilter, whose import alone would double the time that `backlash scan` takes to start.
    """
    out = np.empty_like(values)
    z1, z2 = z[0], z[1]
    for k in range(len(values)):
        x = values[k]
        y = b[0] * x + z1
        z1 = b[1] * x - a[1] * y + z2
        z2 = b[2] * x - a[2] * y
        out[k] = y
    z[0], z[1] = z1, z2
    return out


@dataclass(frozen=True)
class DoubleLag:
    """Coefficients of 1/(1 + s T)^2 sampled every h seconds behind a zero-order hold.

    With a = exp(-h/T), r = h/T:  H(z) = ((1 - a - r a) z + a (a - 1 + r)) / (z - a)^2.
    T = 0 is the identity.
    """

    numerator: FloatArray
    denominator: FloatArray

    @property
    def is_identity(self) -> bool:
        return len(self.denominator) == 1

    @property
    def coefficients(self) -> tuple[float, ...]:
        """b0, b1, b2, a1, a2, also of the identity."""
        if self.is_identity:
            return 1.0, 0.0, 0.0, 0.0, 0.0
        return (*self.numerator.tolist(), *self.denominator[1:].tolist())

    def settled(self, value: float) -> FloatArray:
        """Return the filter state that has rested at `value` for ever."""
        if self.is_identity:
            return np.zeros(0)
        b, a = self.numerator, self.denominator
        # direct form II transposed at rest: z2 = (b2 - a2) v, z1 = (b1 - a1) v + z2 with unit static gain
        z2 = (b[2] - a[2]) * value
        return np.array([(b[1] - a[1]) * value + z2, z2])

    def run(self, values: FloatArray, state: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Filter `values` (samples,) from `state`; return the output and the new state."""
        if self.is_identity:
            return values.copy(), state
        new = state.copy()
        return _filter(self.numerator, self.denominator, np.ascontiguousarray(values), new), new


def double_lag(time_constant: float, interval: float) -> DoubleLag:
    """Return the sampled filter 1/(1 + s T)^2 for T = `time_constant` [s] and sampling `interval` [s].

    Raises ValueError for a negative time constant or an interval that is not positive.
    """
    if interval <= 0 or time_constant < 0:
        raise ValueError(f"need interval > 0 and time constant >= 0, got {interval} and {time_constant}")
    if time_constant == 0:
        return DoubleLag(np.ones(1), np.ones(1))
    r = interval / time_constant
    a = float(np.exp(-r))
    # expm1 keeps the digits when the sampling is fast: 1 - a - r a = -expm1(-r) - r a
    b1 = -float(np.expm1(-r)) - r * a
    b2 = a * (float(np.expm1(-r)) + r)
    return DoubleLag(np.array([0.0, b1, b2]), np.array([1.0, -2.0 * a, a * a]))
