"""Where a model fails: the squared error shared out over parts of the record that an engineer can look up."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ..kernels import play
from ..record import FloatArray
from ..results import Region
from .pipeline import Shape
from .problem import Problem

Mask = NDArray[np.bool_]
# how long an event is felt, in process lags; shares of the output's range that count as its ends
LAGS_FELT = 3.0
ONE_WAY = 0.3  # mean over root mean square of an error from which it is worth saying on which side it lies
END_SHARE = 0.1
TIME_BLOCKS = 8
SMALLEST_SHARE_OF_SAMPLES = 0.005


def regions(problem: Problem, error: FloatArray, shape: Shape) -> tuple[Region, ...]:
    """Return the parts of the record with their share of the squared error, the worst for their size first.

    error: (samples,) measured minus predicted PV, 0 where not used. shape: of the model, for how long it remembers.
    """
    h, lag = problem.interval, shape.lag
    felt = max(int((LAGS_FELT * lag + shape.delay) / h), 2)
    total = float(np.sum(error[problem.used] ** 2))
    count = int(np.count_nonzero(problem.used))
    out = []
    for kind, name, sentence, mask in _masks(problem, error, felt, lag):
        inside = mask & problem.used
        samples = int(np.count_nonzero(inside))
        if samples < max(SMALLEST_SHARE_OF_SAMPLES * count, 5) or samples == count or total <= 0.0:
            continue
        squares = float(np.sum(error[inside] ** 2))
        share, expected, rmse = squares / total, samples / count, float(np.sqrt(squares / samples))
        times, mean = share / expected, float(np.mean(error[inside]))
        worse = f"{times:.1f} times what its" if times >= 1.15 else "no more than its"
        said = (f"{sentence}: {100 * share:.0f} % of the squared error in {100 * expected:.0f} % of the samples, "
                f"{worse} length would give.")
        if abs(mean) >= ONE_WAY * rmse:
            side = "above" if mean > 0.0 else "below"
            said += f" PV lies {100 * abs(mean):.2g} % of span {side} the prediction on average."
        ends = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(np.int8), [0]]))).reshape(-1, 2) - [0, 1]
        stretches = tuple((a, b) for a, b in (problem.start + h * ends).tolist())
        out.append(Region(name, rmse, share, samples, kind, expected, said, stretches))
    out += _frequencies(problem, error, lag, total, count)
    return tuple(sorted(out, key=lambda r: (-(r.share - (r.expected or 0.0)), r.region)))


def _time(seconds: float) -> str:
    """A time span in the unit that suits it."""
    for unit, length in (("h", 3600.0), ("min", 60.0)):
        if seconds >= 2.0 * length:
            return f"{seconds / length:.3g} {unit}"
    return f"{seconds:.3g} s"


def _after(points: Sequence[int], samples: int, felt: int) -> Mask:
    mask = np.zeros(samples, dtype=bool)
    for k in points:
        mask[k : k + felt] = True
    return mask


def turning_points(values: FloatArray, reach: float) -> tuple[list[int], list[int]]:
    """Return where values (samples,) turned upwards and downwards, small turns below `reach` left out."""
    # a stem behind a gap of that width begins to move the other way where the turn is seen
    way = np.sign(np.diff(play(values, reach, values[0]), prepend=values[0]))
    moving = np.flatnonzero(way)
    seen = moving[1:][np.diff(way[moving]) != 0.0]
    up: list[int] = []
    down: list[int] = []
    for before, after in pairwise([0, *seen.tolist()]):
        part = values[before : after + 1]
        (up if way[after] > 0.0 else down).append(before + int(np.argmin(way[after] * part)))
    return up, down


def _masks(problem: Problem, error: FloatArray, felt: int, lag: float) -> Iterator[tuple[str, str, str, Mask]]:
    """Give each part of the record as its kind, its name, the start of a sentence and its samples."""
    u, n = problem.output, problem.samples
    up, down = turning_points(u, max(0.05 * float(np.ptp(u)), 0.005))
    # the time right after a turn, not all the time until the next one
    between = np.diff(np.sort(np.array([*up, *down])))
    turned = min(felt, max(int(np.median(between)) // 2, 2)) if between.size else felt
    for way, turns in (("upwards", up), ("downwards", down)):
        yield "reversal", f"after output reversals, {way}", f"After the output turned {way}", _after(turns, n, turned)

    moved = np.abs(np.diff(problem.setpoint, prepend=problem.setpoint[0]))
    during = _after(np.flatnonzero(moved > max(0.1 * float(np.ptp(problem.setpoint)), 1e-4)).tolist(), n, felt)
    yield "setpoint", "during setpoint moves", "While the loop follows a setpoint move", during
    yield "setpoint", "at constant setpoint", "While the setpoint stands still", ~during

    ends = np.quantile(u[problem.used], [0.0, END_SHARE, 1 / 3, 2 / 3, 1.0 - END_SHARE, 1.0])
    _, first, low, high, last, _ = (f"{100 * x:.0f}" for x in ends)
    for where, mask in ((f"below {low} %", u < ends[2]), (f"above {high} %", u > ends[3])):
        yield "output level", f"output {where}", f"With the output {where}", mask
    middle = (u >= ends[2]) & (u <= ends[3])
    yield "output level", f"output {low} to {high} %", f"With the output between {low} and {high} %", middle
    yield "limit", "near the lowest output", f"Near the lowest output (below {first} %)", u <= ends[1]
    yield "limit", "near the highest output", f"Near the highest output (above {last} %)", u >= ends[4]

    steps = max(int(lag / problem.interval), 1)
    move = u - np.concatenate([np.full(steps, u[0]), u[:-steps]])
    still = max(0.02 * float(np.ptp(u)), 1e-4)
    yield "direction", "output rising", "While the output rises", move > still
    yield "direction", "output falling", "While the output falls", move < -still
    yield "direction", "output resting", "While the output rests", np.abs(move) <= still

    for b in range(TIME_BLOCKS):
        name = f"part {b + 1} of {TIME_BLOCKS} of the record"
        yield "time", name, f"In {name}", np.arange(n) * TIME_BLOCKS // n == b

    said = "Where the error stays on one side for long, as an unmeasured load makes it"
    # stretches in which the mean error keeps its sign much longer than the process remembers
    width, at, sums = max(felt // 3, 1), np.arange(n), np.append(0.0, np.cumsum(error))
    side = np.sign(sums[np.minimum(at + width + 1, n)] - sums[np.maximum(at - width, 0)])
    lengths = np.diff(np.concatenate([[0], np.flatnonzero(np.diff(side)) + 1, [n]]))
    yield "load", "on one side for long", said, np.repeat(lengths >= felt, lengths)


def _frequencies(problem: Problem, error: FloatArray, lag: float, total: float, count: int) -> list[Region]:
    power = np.abs(np.fft.fft(error)) ** 2
    frequency = np.abs(np.fft.fftfreq(problem.samples, problem.interval))
    slow, fast = 1.0 / (20.0 * lag), 1.0 / (2.0 * lag)
    out = []
    for name, said, pick in (
        ("slow changes", f"slower than {_time(20 * lag)}", frequency < slow),
        ("changes at the speed of the loop", f"of {_time(2 * lag)} to {_time(20 * lag)}",
         (frequency >= slow) & (frequency <= fast)),
        ("fast changes", f"faster than {_time(2 * lag)}", frequency > fast),
    ):
        squares = float(power[pick].sum()) / problem.samples
        if total > 0.0 and np.any(pick):
            share, expected = squares / total, float(np.mean(pick))
            sentence = (f"In changes {said}: {100 * share:.0f} % of the squared error; white noise would have "
                        f"{100 * expected:.0f} % there.")
            out.append(Region(name, float(np.sqrt(squares / count)), share, count, "frequency", expected, sentence))
    return out
