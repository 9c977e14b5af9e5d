"""Recording in steps: what transmitter and historian leave of PV.

Quantization: transmitter or recorder rounds to a step, or repeats the old value until it has moved by a step.

>>> QUANTIZATION.apply([0.500, 0.503, 0.508], QUANTIZATION.pack(step=0.005), interval=1.0).round(3).tolist()
[0.5, 0.505, 0.51]
>>> QUANTIZATION.apply([0.500, 0.503, 0.508], QUANTIZATION.pack(step=0.005, hold=1.0), interval=1.0).tolist()
[0.5, 0.5, 0.508]
>>> QUANTIZATION.apply([0.500, 0.503, 0.508], QUANTIZATION.neutral, interval=1.0).tolist()
[0.5, 0.503, 0.508]

Exception compression: the recorder keeps the old value until the signal has moved by more than a deviation. A
historian that draws straight lines between kept values is `simulator.scenario.draw_lines`: it needs the whole record.

>>> p = EXCEPTION_COMPRESSION.pack(deviation=0.01)
>>> EXCEPTION_COMPRESSION.apply([0.5, 0.505, 0.511, 0.515, 0.5], p, interval=1.0).tolist()
[0.5, 0.5, 0.511, 0.511, 0.5]"""

import numpy as np

from ..record import FloatArray
from .fitting import Clues, Fitting
from .shape import Stage, effect

# share of samples that repeat the one before, above which rounding counts: with white noise of standard deviation s
# a rounding step q repeats this often at q = 1.5 s, where the rounding error is a fifth of the noise variance
REPEATS = 0.4
SHARP = 0.9  # smallest report of an exception test, its deviation, over the one in twenty that is next


def nothing_kept(p: FloatArray, interval: float, first: float) -> FloatArray:
    """State: [value kept last]; nothing has been kept before the first sample."""
    return np.array([np.inf])


def recorded_step(state: FloatArray, value: float, p: FloatArray) -> float:
    if p[0] == 0.0:
        return value
    if p.size == 2 and p[1] == 0.0:
        return float(np.rint(value / p[0])) * p[0]
    if abs(value - state[0]) > p[0]:
        state[0] = value
    return state[0]


def bounds(measurement: FloatArray, p: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the lowest and highest true value of each recorded sample; one that was just kept is exact."""
    if p.size == 2 and p[1] == 0.0:
        return measurement - 0.5 * p[0], measurement + 0.5 * p[0]
    reach = np.where(np.diff(measurement, prepend=np.nan) != 0.0, 0.0, p[0])
    return measurement - reach, measurement + reach


def recorded_steps(values: FloatArray) -> tuple[float, str]:
    """Return the step that the repeated values (samples,) of a recorded signal show, and how it came about.

    "rounded": few levels, a whole number of steps apart. "reported": no report is smaller than the step. "held": old
    values are repeated, and some reports are small, as where a report is due after a longest time. "": no step."""
    jumps = np.abs(np.diff(values))
    moved = jumps[jumps > 0.0]
    if moved.size < 3 or moved.size > (1.0 - REPEATS) * jumps.size:
        return 0.0, ""
    levels = np.unique(values)
    apart = np.diff(levels)
    # a rounded record has few levels, a whole number of steps apart; a record of exceptions has a level per report
    grid = float(np.median(apart[apart > 0.1 * np.median(apart)]))
    off = np.abs(moved / grid - np.rint(moved / grid))
    if levels.size < 0.5 * moved.size and np.mean(off < 0.05) > 0.9:
        return grid, "rounded"
    if float(np.min(moved)) > SHARP * float(np.quantile(moved, 0.05)):
        return float(np.min(moved)), "reported"
    return float(np.quantile(moved, 0.1)), "held"


def shown(clues: Clues) -> tuple[float, str]:
    return recorded_steps(clues.measurement[clues.used])


QUANTIZATION = effect("quantization", Stage.SENSOR, nothing_kept, recorded_step, fitting=Fitting(
    fixed=("step", "hold"), bounds=bounds, propose=lambda clues: [
        {"step": step, "hold": float(how == "held")} for step, how in [shown(clues)] if how in ("rounded", "held")]))

EXCEPTION_COMPRESSION = effect("exception_compression", Stage.SENSOR, nothing_kept, recorded_step, fitting=Fitting(
    fixed=("deviation",), bounds=bounds,
    propose=lambda clues: [{"deviation": step} for step, how in [shown(clues)] if how == "reported"]))
