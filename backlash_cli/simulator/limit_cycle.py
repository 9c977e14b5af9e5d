"""Does backlash make this loop oscillate by itself, how fast and how far? From the describing function (1) of backlash.

N is gain and phase that a gap gives to a sine of amplitude a. With r = d/a, for a >= d/2 (a smaller sine does not move
the valve at all): Re N = 1/pi [ pi/2 + asin(1 - r) + (1 - r) sqrt(r (2 - r)) ],  Im N = -1/pi r (2 - r).
N depends on d/a only. Source: Haegglund (2007), eq. 1."""

from typing import NamedTuple

import numpy as np

from ..errors import UsageError
from ..record import FloatArray
from .controller import Controller
from .process import ComplexArray, Process

# d/a from a hardly disturbed sine to one that hardly moves the valve; closer together at the ends, where N turns fast
RATIOS = 1.0 - np.cos(np.linspace(1e-3, np.pi - 1e-3, 20001))


def describing_function(ratio: object) -> ComplexArray:
    """Return N(d/a), complex, for the ratio of dead band to input amplitude, each 0..2 (else UsageError)."""
    r = np.asarray(ratio, dtype=np.float64)
    if np.any(r < 0.0) or np.any(r > 2.0):
        raise UsageError("d/a must lie in 0..2", remedy="the amplitude must be at least half the dead band")
    rest, square = 1.0 - r, r * (2.0 - r)
    real = 0.5 * np.pi + np.arcsin(rest) + rest * np.sqrt(square)
    return np.asarray((real - 1j * square) / np.pi, dtype=np.complex128)


class LimitCycle(NamedTuple):
    """A lasting oscillation: period [s], and half of peak to peak [span] of output and measurement."""

    period: float
    amplitude_u: float
    amplitude_y: float


def limit_cycle(controller: Controller, process: Process, d: float) -> LimitCycle | None:
    """Return the stable limit cycle that a dead band d [span] causes, or None when there is none.

    Solves C(i w) P(i w) N(d/a) = -1. The period does not depend on d, the amplitudes are proportional to it.
    Stable in the sense of Loeb: a slightly larger oscillation dies down, a smaller one grows. A loop that is unstable
    without any dead band is outside this question."""
    from scipy.optimize import brentq
    # the phase of N falls steadily from 0 to -pi/2 while the sine gets smaller, so it can be read backwards
    phases = -np.angle(describing_function(RATIOS))

    def open_loop(omega: object) -> ComplexArray:
        return controller.response(omega) * process.response(omega)

    def ratio_at(log_omega: FloatArray | float) -> FloatArray:
        return np.interp(np.angle(-open_loop(np.exp(log_omega))), phases, RATIOS, left=np.nan, right=np.nan)

    def excess(log_omega: FloatArray | float) -> FloatArray:
        ratio = ratio_at(log_omega)
        gain = np.abs(describing_function(np.nan_to_num(ratio)))
        return np.where(np.isfinite(ratio), np.log(np.abs(open_loop(np.exp(log_omega))) * gain), np.nan)

    def stable(omega: float, ratio: float) -> bool:
        # a larger amplitude, a smaller d/a, shifts the loop's pole to the left: Re(-(dN/da / N) (L / (dL/ds))) < 0
        h = 1e-6
        slope = np.diff(describing_function(ratio * np.array([1.0 + h, 1.0 - h])))[0] / describing_function(ratio)
        down, at, up = open_loop(omega * np.array([1.0 - h, 1.0, 1.0 + h]))
        return bool((-slope * at / ((up - down) / (omega * 1j))).real < 0.0)

    grid = _frequencies(controller, process)  # along w, d/a follows from the phase of N and the size decides
    values = excess(grid)
    spans = np.flatnonzero((values[:-1] * values[1:] < 0.0) & (d > 0.0))
    roots = [float(brentq(lambda w: float(excess(w)), grid[k], grid[k + 1], xtol=1e-12)) for k in spans]
    cycles = [(float(ratio_at(root)), float(np.exp(root))) for root in roots]
    # of several stable cycles the largest is the one a disturbance ends in
    ratio, omega = min((cycle for cycle in cycles if stable(cycle[1], cycle[0])), default=(0.0, 0.0))
    if not omega:
        return None
    gain = abs(describing_function(ratio) * process.response(omega))
    return LimitCycle(2.0 * np.pi / omega, d / ratio, float(d / ratio * gain))


def _frequencies(controller: Controller, process: Process) -> FloatArray:
    """Logarithms of frequencies [rad/s] that span all time constants of the loop, (frequencies,)."""
    with np.errstate(divide="ignore"):
        roots = 1.0 / np.abs(np.roots(process.denominator))
    times = [controller.Ti, controller.Td, controller.filter_time, process.dead_time, *process.lags, *roots]
    used = [t for t in times if 0.0 < t < np.inf]
    return np.linspace(np.log(1e-3 / max(used)), np.log(1e2 / min(used)), 1500)
