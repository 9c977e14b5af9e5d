"""Where a model fails: the squared error shared out over parts of the record that an engineer can look up."""

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np

from ..kernels import play
from ..record import BoolArray, FloatArray, duration, runs
from ..results import Region
from ..words import said
from .pipeline import Shape
from .problem import Problem

Mask = BoolArray
LAGS_FELT = 3.0  # how long an event is felt, in process lags
ONE_WAY = 0.3  # mean over root mean square of an error from which it is worth saying on which side it lies
END_SHARE = 0.1
TIME_BLOCKS = 8
SMALLEST_SHARE_OF_SAMPLES = 0.005


def regions(problem: Problem, error: FloatArray, shape: Shape) -> tuple[Region, ...]:
    """Return the parts of the record with their share of the squared error, the worst for their size first; error:
    (samples,) measured minus predicted PV, 0 where not used. shape: of the model, for how long it remembers."""
    h, lag, used = problem.interval, shape.lag, problem.used
    felt = max(int((LAGS_FELT * lag + shape.delay) / h), 2)
    total, count = float(np.sum(error[used] ** 2)), int(np.count_nonzero(used))
    if total <= 0.0:
        return ()
    out = []
    for kind, name, mask in _masks(problem, error, felt, lag):
        inside = error[mask & used]
        if not max(SMALLEST_SHARE_OF_SAMPLES * count, 5) <= inside.size < count:
            continue
        squares, mean = float(np.sum(inside**2)), float(np.mean(inside))
        share, expected, rmse = squares / total, inside.size / count, float(np.sqrt(squares / inside.size))
        worse = f"{share / expected:.1f} times what its" if share >= 1.15 * expected else "no more than its"
        told = said("region", name=name[0].upper() + name[1:], share=share, expected=expected, worse=worse)
        if abs(mean) >= ONE_WAY * rmse:
            told += said("region:side", mean=abs(mean), side="above" if mean > 0.0 else "below")
        ends = np.transpose(runs(mask)) - [0, 1]
        stretches = tuple((a, b) for a, b in (problem.start + h * ends).tolist())
        out.append(Region(name, rmse, share, inside.size, kind, expected, told, stretches))
    power = np.abs(np.fft.fft(error)) ** 2 / problem.samples
    band = np.digitize(np.abs(np.fft.fftfreq(problem.samples, h)), [1.0 / (20.0 * lag), 1.0 / (2.0 * lag)])
    fast, slow = duration(2.0 * lag), duration(20.0 * lag)
    for number, (name, speed) in enumerate((("slow changes", f"slower than {slow}"), (
            "changes at the speed of the loop", f"of {fast} to {slow}"), ("fast changes", f"faster than {fast}"))):
        share, expected = float(np.sum(power[band == number])) / total, float(np.mean(band == number))
        if expected:
            told = said("region:band", speed=speed, share=share, expected=expected)
            out.append(Region(name, float(np.sqrt(share * total / count)), share, count, "frequency", expected, told))
    return tuple(sorted(out, key=lambda r: (-(r.share - (r.expected or 0.0)), r.region)))


def _after(points: Sequence[int], samples: int, felt: int) -> Mask:
    count = np.cumsum(np.bincount(np.asarray(points, dtype=np.int64), minlength=samples))
    return np.asarray(count > np.append(np.zeros(felt), count)[:samples])


def turning_points(values: FloatArray, reach: float) -> tuple[list[int], list[int]]:
    """Return where values (samples,) turned upwards and downwards, small turns below `reach` left out."""
    # a stem behind a gap of that width begins to move the other way where the turn is seen
    way = np.sign(np.diff(play(values, reach, values[0]), prepend=values[0]))
    moving = np.flatnonzero(way)
    found: dict[float, list[int]] = {1.0: [], -1.0: []}
    for before, after in pairwise([0, *moving[1:][np.diff(way[moving]) != 0.0].tolist()]):
        found[way[after]].append(before + int(np.argmin(way[after] * values[before : after + 1])))
    return found[1.0], found[-1.0]


def _masks(problem: Problem, error: FloatArray, felt: int, lag: float) -> Iterator[tuple[str, str, Mask]]:
    """Give each part of the record as its kind, its name and its samples."""
    u, n = problem.output, problem.samples
    up, down = turning_points(u, max(0.05 * float(np.ptp(u)), 0.005))
    # the time right after a turn, not all the time until the next one
    between = np.diff(np.sort(np.array([*up, *down])))
    turned = min(felt, max(int(np.median(between)) // 2, 2)) if between.size else felt
    for way, turns in (("upwards", up), ("downwards", down)):
        yield "reversal", f"after output reversals, {way}", _after(turns, n, turned)

    moved = np.abs(np.diff(problem.setpoint, prepend=problem.setpoint[0]))
    during = _after(np.flatnonzero(moved > max(0.1 * float(np.ptp(problem.setpoint)), 1e-4)).tolist(), n, felt)
    yield "setpoint", "during setpoint moves", during
    yield "setpoint", "at constant setpoint", ~during

    ends = np.quantile(u[problem.used], [0.0, END_SHARE, 1 / 3, 2 / 3, 1.0 - END_SHARE, 1.0])
    _, first, low, high, last, _ = (f"{100 * x:.0f}" for x in ends)
    yield "output level", f"output below {low} %", u < ends[2]
    yield "output level", f"output above {high} %", u > ends[3]
    yield "output level", f"output {low} to {high} %", (u >= ends[2]) & (u <= ends[3])
    yield "limit", f"near the lowest output (below {first} %)", u <= ends[1]
    yield "limit", f"near the highest output (above {last} %)", u >= ends[4]

    steps = max(int(lag / problem.interval), 1)
    move = u - np.concatenate([np.full(steps, u[0]), u[:-steps]])
    still = max(0.02 * float(np.ptp(u)), 1e-4)
    yield "direction", "output rising", move > still
    yield "direction", "output falling", move < -still
    yield "direction", "output resting", np.abs(move) <= still
    for b in range(TIME_BLOCKS):
        yield "time", f"part {b + 1} of {TIME_BLOCKS} of the record", np.arange(n) * TIME_BLOCKS // n == b

    # stretches in which the mean error keeps its sign much longer than the process remembers
    width, at, sums = max(felt // 3, 1), np.arange(n), np.append(0.0, np.cumsum(error))
    side = np.sign(sums[np.minimum(at + width + 1, n)] - sums[np.maximum(at - width, 0)])
    lengths = np.diff(np.concatenate([[0], np.flatnonzero(np.diff(side)) + 1, [n]]))
    yield "load", "error on one side for long, as under a load", np.repeat(lengths >= felt, lengths)
