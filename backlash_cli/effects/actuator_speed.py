"""Speed of the actuator, the same both ways or not.

Rate limit: the position runs to the command with at most `rate` spans per second, so large moves arrive late. The
output sample is the mean position over the interval, exact for a slow process to second order in interval / lag.

>>> RATE_LIMIT.apply([0.0, 0.25, 0.25, 0.25, 0.25], RATE_LIMIT.pack(rate=0.1), interval=1.0).round(4).tolist()
[0.0, 0.05, 0.15, 0.2375, 0.25]

Unequal speed: the actuator opens at one speed and closes at another, as a spring return or a blocked vent makes it.

>>> p = UNEQUAL_SPEED.pack(opening=0.2, closing=0.1)
>>> UNEQUAL_SPEED.apply([0.0, 0.2, 0.2, 0.0, 0.0], p, interval=1.0).round(3).tolist()
[0.0, 0.1, 0.2, 0.15, 0.05]"""

import numpy as np

from ..record import FloatArray
from .fitting import Clues, Fitting, Values
from .shape import Stage, effect


def start(p: FloatArray, interval: float, first: float) -> FloatArray:
    """State: [position at the start of the sample, largest rise and largest fall in one sample]."""
    return np.array([first, p[0] * interval, p[-1] * interval])


def step(state: FloatArray, value: float, p: FloatArray) -> float:
    position, move = state[0], value - state[0]
    reach = state[1] if move > 0.0 else state[2]
    if abs(move) > reach:
        state[0] = position + reach if move > 0.0 else position - reach
        return 0.5 * (position + state[0])
    state[0] = value
    return value if move == 0.0 or reach == np.inf else value - move * abs(move) / (2.0 * reach)


def speeds(clues: Clues) -> list[Values]:
    """Return speeds that cross the output's usual travel in a fraction of the process lag up to many lags."""
    travel = max(float(np.ptp(np.quantile(clues.output, [0.05, 0.95]))), 1e-3)
    # two speeds that turn out alike are one
    alike = [float(speed) for speed in clues.known.get("unequal_speed", {}).values()]  # type: ignore[arg-type]
    rates = [*(travel / (share * clues.lag) for share in (0.1, 0.2, 0.4, 0.8, 1.5, 3.0, 6.0, 12.0)), *alike]
    return [{"rate": rate} for rate in rates]


RATE_LIMIT = effect("rate_limit", Stage.VALVE, start, step, fitting=Fitting(
    propose=speeds, rivals=("unequal_speed", "dead_time", "second_lag")))


def unequal_speeds(clues: Clues) -> list[Values]:
    """Return slow speeds one way, with the other way free or three times as fast."""
    slow = [float(v["rate"]) for v in speeds(clues)]  # type: ignore[arg-type]
    both = [(a, b) for a in slow for b in (3.0 * a, 1e3 * a)]
    return [{"opening": a, "closing": b} for pair in both for a, b in (pair, pair[::-1])]


UNEQUAL_SPEED = effect("unequal_speed", Stage.VALVE, start, step, fitting=Fitting(propose=unequal_speeds, seldom=True,
    siblings=("rate_limit",)))
