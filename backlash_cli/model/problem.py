"""One loop's recording as a model sees it: a gapless grid of OP and PV, with a mask of the samples that count.

A model that predicts PV from OP alone can be judged by its error only where OP moved for another reason than PV. Where
the loop answers to its load, OP is a mirror of that load: there a wrong model with a small gain has the smaller error
(Ljung, System Identification, section 13.4: output error is biased in closed loop, prediction errors are not).

Whether the valve got OP as the historian rounded it or as it was before is not known beforehand: a search tries both.
"""

from collections.abc import Mapping
from dataclasses import field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..effects.process import delayed_lag
from ..effects.recording import recorded_steps
from ..errors import LoopError
from ..estimator.control_law import output_made
from ..record import BoolArray, FloatArray, Frozen, LoopSettings, Record, SampleState, hold, runs
from ..words import explained

FEWEST_SAMPLES = 100  # fewer samples than this cannot carry a model with three parameters, a hold-out and a search
SHORT, FORGOTTEN = 0.25, 4.0  # integral times: holes of OP that do no harm, and after which one is forgotten
LAGS = 7  # shapes of the answer of OP to a setpoint move: lags from one sample to a quarter of the record
MOSTLY = 0.5  # share from which the error of a prediction from OP alone is the measure
AHEAD = 0.5  # a load-driven loop is predicted this share of Ti ahead: well before OP can answer to what came meanwhile
VISIBLE, PART = 2.0, 50.0  # without Ti: until PV has moved by so many times its noise, a part of the record at most
FEWEST_MOVES = 50  # fewer moves than this tell nothing about a step
# a load behind the process forgets within about three lags: six hold one independent error, so many count at most
LAGS_PER_STRETCH, MOST_STRETCHES = 6.0, 150
JUMP = 1.5  # moves of this many steps at once are jumps of OP, no crossings


class Problem(Frozen, eq=False):
    """Uniform grid of one loop: all arrays (samples,), normalised, without nan.

    output: OP, straight lines over holes. measurement: PV, 0 where `used` is False. recorded: PV with nan in holes.
    setpoint: SP, held over holes. columns: means of further measured columns up to the next sample, holes interpolated.
    delay: dead time [s], where the settings give one. holes: of OP that matter. floor: standard deviation of the
    measurement noise [span]. driven: share of OP's motion that comes from the setpoint or the operator. ahead: samples
    that a loop driven by its load is predicted ahead. output_step: in which OP was recorded [span], 0 when it hardly
    matters. seed: of random trials of a search. start: epoch seconds of the first sample. origin: as of `output_made`.
    others: columns of the last shapes, and OP as their valves moved it, by what made them; most trials leave them."""

    loop: str
    interval: float
    output: FloatArray
    measurement: FloatArray
    recorded: FloatArray
    setpoint: FloatArray
    used: BoolArray
    columns: Mapping[str, FloatArray]
    delay: float | None
    settings: LoopSettings
    holes: int = 0
    floor: float = 1e-4
    driven: float = 1.0
    ahead: int = 1
    output_step: float = 0.0
    seed: int = 0
    start: float = 0.0
    origin: str = "recorded"
    others: dict[object, Any] = field(default_factory=dict, repr=False)

    @property
    def samples(self) -> int:
        return len(self.output)

    @property
    def duration(self) -> float:
        return self.samples * self.interval

    @property
    def time(self) -> FloatArray:
        """Epoch seconds of the samples, (samples,)."""
        return self.start + self.interval * np.arange(self.samples, dtype=np.float64)

    @property
    def by_load(self) -> bool:
        """True where OP answers to the load: PV is then predicted a short time ahead, not from OP alone."""
        return self.driven < MOSTLY


def problem_from_record(record: Record, seed: int = 0) -> Problem:
    """Lay a record on its grid. Raises LoopError where OP is absent, OP or PV constant, or too few samples count."""
    where = record.loop
    if record.output is None:
        raise LoopError(**explained("model_no_output"), where=where)
    if len(record) == 0:
        raise LoopError(**explained("no_samples"), where=where)
    index = record.index - record.index[0]
    samples = int(index[-1]) + 1

    def on_grid(values: NDArray[Any]) -> FloatArray:
        out = np.full(samples, np.nan)
        out[index] = values
        return out

    state, (made, origin) = on_grid(record.state), output_made(record, record.settings)
    assert made is not None  # some of it was recorded
    measurement, output, setpoint = map(on_grid, (record.measurement, made, record.setpoint))
    # PV is predicted from OP whoever moves OP: manual periods and OP at a limit tell as much as automatic ones
    whole = np.isin(state, (SampleState.GOOD, SampleState.MANUAL, SampleState.SATURATED))
    used = whole & np.isfinite(measurement) & np.isfinite(output)
    count = int(np.count_nonzero(used))
    # a signal that never moves is marked frozen as a whole: that is the reason to give, not its consequence
    shown = used if count >= FEWEST_SAMPLES else np.ones(samples, dtype=bool)
    for name, signal in (("OP", output), ("PV", measurement)):
        values = signal[shown & np.isfinite(signal)]
        if values.size and np.ptp(values) <= 1e-9 * max(1.0, float(np.max(np.abs(values)))):
            raise LoopError(**explained("constant_signal", signal=name, value=values[0]), where=where)
    if count < FEWEST_SAMPLES:
        raise LoopError(**explained("few_samples", count=count, least=FEWEST_SAMPLES), where=where)
    recorded = np.where(used, measurement, np.nan)
    # PV does not count where it answers to a hole of OP, unless it does so most of the time
    memory, felt = (record.settings.Ti or record.interval * samples / 60.0) / record.interval, np.zeros(samples, bool)
    holes = [(a, b) for a, b in np.transpose(runs(~np.isfinite(output))).tolist() if b - a > max(SHORT * memory, 1)]
    for a, b in holes:
        felt[a : b + int(FORGOTTEN * memory)] = True
    heard = bool(np.count_nonzero(used & ~felt) > max(0.5 * count, FEWEST_SAMPLES))
    used &= ~felt | (not heard)
    columns = {}
    for name, values in record.disturbances.items():
        grid = on_grid(values)
        if np.count_nonzero(np.isfinite(grid)) >= 0.5 * samples and np.nanstd(grid) > 0:
            signal = _interpolate(grid)  # the mean from each sample to the next: unlike OP it moves on between scans
            columns[name] = 0.5 * (signal + np.append(signal[1:], signal[-1]))
    moved, floor, h = _interpolate(output), noise_floor(recorded), record.interval
    setpoint = np.nan_to_num(hold(setpoint))
    return Problem(record.loop, h, moved, np.where(used, measurement, 0.0), recorded, setpoint, used, columns,
        record.settings.theta or None, record.settings, len(holes) * heard, floor, moved_from_outside(moved, setpoint,
        state == SampleState.MANUAL, used, h), horizon(recorded, floor, h, record.settings.Ti), step_of(moved), seed,
        float(record.time[0]), origin)


def readings(problem: Problem) -> list[Problem]:
    """Return the problem, and with OP as it may have been before it was rounded, where it was rounded coarsely."""
    if not problem.output_step:
        return [problem]
    return [problem, replace(problem, output=between_steps(problem.output, problem.output_step), others={})]


def usual_output(problem: Problem) -> tuple[float, float] | None:
    """Return the range in which OP [span] was for all but one sample in fifty; None where it hardly moved."""
    low, high = np.quantile(problem.output[problem.used], [0.01, 0.99])
    return (float(low), float(high)) if high > low + 1e-6 else None


def noise_floor(recorded: FloatArray) -> float:
    """Return the standard deviation of white measurement noise in PV (samples,), nan in holes, by third differences."""
    squares = np.sort(np.diff(recorded, 3) ** 2)
    squares = squares[np.isfinite(squares)]
    if squares.size == 0:
        return 1e-4
    # a kink of the process, such as the start of an answer to a step, is no noise: the largest 5 % are left out, and
    # what a normal distribution has there is put back (mean square within 1.96 deviations: 0.759)
    inner = float(np.mean(squares[: max(int(0.95 * squares.size), 1)])) / 0.759
    return max(float(np.sqrt(min(inner, float(np.mean(squares))) / 20.0)), 1e-7)


def _interpolate(values: FloatArray) -> FloatArray:
    good = np.flatnonzero(np.isfinite(values))
    return np.interp(np.arange(len(values)), good, values[good])


def moved_from_outside(output: FloatArray, setpoint: FloatArray, manual: BoolArray, used: BoolArray,
                       h: float) -> float:
    """Return the share (0..1) of OP's variance that setpoint moves, behind lags, or a hand explain. h: interval [s]."""
    y = output[used]
    spread = float(np.var(y))
    if spread <= 0.0:
        return 0.0
    columns = [np.ones_like(output)]
    if np.ptp(setpoint[used]) > 0.0:
        taus = np.geomspace(h, max(0.25 * h * len(output), 2.0 * h), LAGS)
        columns += [setpoint, *(delayed_lag(setpoint, h, tau, 0.0) for tau in taus)]
    by_hand = manual & used
    if np.count_nonzero(by_hand) > 1 and np.ptp(output[by_hand]) > 0.0:
        columns += [by_hand.astype(np.float64), np.where(by_hand, output - np.mean(output[by_hand]), 0.0)]
    X = np.column_stack(columns)[used]
    X -= X.mean(axis=0)
    X /= np.maximum(X.std(axis=0), 1e-12)
    A = X.T @ X + 1e-6 * len(y) * np.eye(X.shape[1])
    rest = y - y.mean() - X @ np.linalg.solve(A, X.T @ (y - y.mean()))
    return float(np.clip(1.0 - np.var(rest) / spread, 0.0, 1.0))


def trust(share: float) -> float:
    """Return how much the error of the prediction from OP alone tells, 0..1, for a share moved from outside: as in a
    Wiener filter 1 / (1 + (load / signal)^2), with the variances of OP as load and signal."""
    return share**2 / (share**2 + (1.0 - share) ** 2)


def horizon(recorded: FloatArray, floor: float, h: float, Ti: float | None) -> int:
    """Return how many samples ahead a load-driven loop is predicted; recorded: (samples,) PV, nan in holes."""
    most = max(int(len(recorded) / PART), 1)
    if Ti:
        return int(np.clip(round(AHEAD * Ti / h), 1, most))
    m = 1
    while m < most and np.nanmean((recorded[m:] - recorded[:-m]) ** 2) < 2.0 * (VISIBLE * floor) ** 2:
        m = max(m + 1, int(1.25 * m))
    return min(m, most)


def step_of(output: FloatArray) -> float:
    """Return the step in which OP (samples,) was recorded, 0 when it was not recorded in coarse steps."""
    moves = np.abs(np.diff(output))
    moves, (step, how) = moves[moves > 1e-9], recorded_steps(output)
    # an operator's moves are few and large; rounding leaves mostly moves of one step
    return step if how == "rounded" and moves.size >= FEWEST_MOVES and np.mean(moves < JUMP * step) > 0.5 else 0.0


def between_steps(output: FloatArray, step: float) -> FloatArray:
    """Return OP (samples,) as it may have been before it was rounded to `step`: where it went from one level to the
    next it crossed the middle between them, where it turned it came on average as far as the level."""
    at, moves = np.arange(len(output), dtype=np.float64), np.flatnonzero(np.abs(np.diff(output)) > 1e-9) + 1
    first, last = np.append(0, moves), np.append(moves, len(output)) - 1
    level = output[first]
    before, after = np.append(0.0, np.diff(level)), np.append(np.diff(level), 0.0)
    came, goes = np.abs(before) > JUMP * step, np.abs(after) > JUMP * step
    turned, crosses = (before * after <= 0.0) & (last > first), (after != 0.0) & ~goes
    ends = [0, -1]
    where = np.concatenate([at[ends], first[came], (0.5 * (first + last))[turned], last[goes], last[crosses] + 0.5])
    value = np.concatenate([output[ends], level[came], level[turned], level[goes], (level + 0.5 * after)[crosses]])
    order = np.argsort(where, kind="stable")
    return np.interp(at, where[order], value[order])
