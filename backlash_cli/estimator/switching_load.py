"""A load that switches to and fro at even intervals (an on/off heater, a pump), fitted together with the dead band.

Every reversal of OP then falls on a step of the load, and steps of any size at any time, as the plain test allows,
hide a dead band or imitate one. An even square wave that acts where the valve acts has three unknowns instead:
amplitude, half period, phase. It is fitted without and with a dead band; a load found so replaces the plain test
when it explains PV better than all single steps together.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..record import FloatArray
from .evidence import Evidence
from .fitter import Fitter
from .likelihood import HIGHEST, LOWEST, T_FREEDOM
from .profile import between, likelihood_interval
from .rows import Rows
from .square_wave import Wave, opposed_wave, square

BETTER = 20.0  # nats by which the square wave must explain PV better than single steps
REACH = 100.0  # nats that a dead band may still add to it: on simulated square loads it is better without one already
AMPLITUDES = (0.6, 0.85, 1.0)  # of the swing of OP: a dead band makes OP swing wider than the load
DELAYS = (0.0, 0.07, 0.14, 0.21, 0.3)  # half periods that OP may lag behind the load
SHAPES = tuple((share, ratio) for ratio in (-11.0, -5.0, 0.0) for share in (0.6, 1.4))
NEARLY = 12.0  # nats below the best: widths within are searched more closely
LEAST_GAIN = 0.05  # nats: smaller steps of the fit are its end


@dataclass(frozen=True)
class _Point:
    """One model: shape numbers p of the process and noise, the load, the dead band, log-likelihood."""

    p: FloatArray
    load: Wave
    d: float
    level: float = -np.inf


class _Search:
    """Maximises the likelihood of one loop's rows over shape numbers, load and dead band."""

    def __init__(self, rows: Rows, load: Wave) -> None:
        self.rows, self.fit = rows, Fitter(replace(rows, line=np.empty((0, len(rows.y)))))
        at = rows.at if rows.at is not None else np.arange(len(rows.y))
        self.time = at - at[0] - 0.5 * float(at[-1] - at[0])
        self.swing, self.drift = load.amplitude, load.half / max(float(at[-1] - at[0]), 1.0)

    def valve(self, d: float, part: float = 1.0) -> FloatArray:
        """OP through a dead band of d (between none and the first width: a mixture), mixed with OP itself."""
        rows = self.rows
        width = min(d, float(rows.widths[-1]))
        small = min(width / float(rows.widths[0]), 1.0)
        through = between(rows.x, rows.widths, width) if small == 1.0 else (1.0 - small) * rows.x[0] + small * rows.x[1]
        mixed: FloatArray = part * through + (1.0 - part) * rows.x[0]
        return mixed

    def position(self, load: Wave, valve: FloatArray) -> FloatArray:
        wave = square(self.time, load.half, load.phase)
        moved: FloatArray = valve + load.amplitude * (wave - wave[0])
        return moved

    def level(self, point: _Point, valve: FloatArray) -> float:
        return float(self.fit.pair(point.p, self.position(point.load, valve))[0][0])

    def start(self, load: Wave) -> _Point:
        """The best model without a dead band on a grid of shapes, amplitudes and phases."""
        loads = [replace(load, amplitude=a * load.amplitude, phase=load.phase - late * load.half)
                 for a in AMPLITUDES for late in DELAYS]
        x = np.stack([self.position(one, self.rows.x[0]) for one in loads])
        found = []
        for share, ratio in SHAPES:
            p = np.array([np.log(self.rows.lag * share), ratio, -2.0])
            levels = self.fit.ll(p, x)
            k = int(np.argmax(levels))
            found.append(_Point(p, loads[k], 0.0, float(levels[k])))
        found.sort(key=lambda point: -point.level)
        best = [self.polish(self.climb(point, self.rows.x[0], (0.35, 0.8, 1.0, 0.1, 1.0), 4), d_free=False)
                for point in found[:2]]
        return max(best, key=lambda point: point.level)

    def climb(self, point: _Point, valve: FloatArray, steps: tuple[float, ...], rounds: int) -> _Point:
        """One number after the other with halving steps: shape numbers, amplitude [its start], phase [rows]."""
        point = replace(point, level=self.level(point, valve))
        for k in range(rounds):
            for i, step in enumerate(steps):
                for size in (step / 2**k, -step / 2**k):
                    moved = False
                    while (trial := self._shifted(point, i, size)) is not None:
                        level = self.level(trial, valve)
                        if level <= point.level + 0.2:
                            break
                        point, moved = replace(trial, level=level), True
                    if moved:
                        break
        return point

    def _shifted(self, point: _Point, i: int, size: float) -> _Point | None:
        if i < 3:
            p = point.p.copy()
            p[i] += size
            return replace(point, p=p) if LOWEST[i] <= p[i] <= HIGHEST[i] else None
        load = point.load
        if i == 3:
            amplitude = load.amplitude + size * self.swing
            return replace(point, load=replace(load, amplitude=amplitude)) if amplitude > 0 else None
        return replace(point, load=replace(load, phase=load.phase + size))

    def along_widths(self, point: _Point) -> list[_Point]:
        """The best model at each width, each search started beside the one before: upwards, then back down."""
        widths = self.rows.widths
        found: list[_Point] = []
        before = point
        for j in range(len(widths)):
            nearby = self._beside(before, j)
            if nearby is None:
                break
            found.append(nearby)
            before = nearby
        top = int(np.argmax([one.level for one in found])) if found else 0
        for j in range(top - 1, -1, -1):
            nearby = self._beside(found[j + 1], j)
            if nearby is not None and nearby.level > found[j].level:
                found[j] = nearby
        close = max((one.level for one in found), default=0.0) - NEARLY
        return [self._together(one, 1.0, d_free=False) if one.level > close else one for one in found]

    def _beside(self, point: _Point, j: int) -> _Point | None:
        """The load is smaller by up to half of what the dead band is larger: OP crosses that much more at each step."""
        d, valve = float(self.rows.widths[j]), self.rows.x[j + 1]
        tried = []
        for share in (1.0, 0.5, 0.0):
            amplitude = point.load.amplitude - share * (d - point.d) / 2.0
            if amplitude > 0.05 * self.swing:
                one = replace(point, d=d, load=replace(point.load, amplitude=amplitude))
                tried.append(replace(one, level=self.level(one, valve)))
        if not tried:
            return None
        return self.climb(max(tried, key=lambda one: one.level), valve, (0.17, 0.8, 1.0, 0.05, 0.25), 2)

    def polish(self, point: _Point, part: float = 1.0, d_free: bool = True) -> _Point:
        """Dead band, amplitude, phase and half period together, then the shape numbers, until nothing is gained."""
        for _ in range(3):
            point = self._together(point, part, d_free)
            next_one = self.climb(point, self.valve(point.d, part), (0.1, 0.8, 1.0), 1)
            if next_one.level < point.level + 0.3:
                return next_one
            point = next_one
        return point

    def _together(self, point: _Point, part: float, d_free: bool) -> _Point:
        """Levenberg-Marquardt on the whitened residuals with the weights of Student's t, by differences."""
        least, most = (float(self.rows.widths[k]) if d_free else point.d for k in (0, -1))
        free = np.arange(0 if d_free else 1, 4)
        theta = np.array([point.d, point.load.amplitude, point.load.phase, point.load.half])
        small = np.array([-0.02 * max(point.d, 0.004), 0.02 * theta[1], 0.1, 0.1 * self.drift])

        def run(several: list[FloatArray]) -> tuple[FloatArray, FloatArray, FloatArray]:
            x = [self.position(Wave(t[1], t[3], t[2]), self.valve(max(t[0], 0.0), part)) for t in several]
            found = []
            for i in range(0, len(x), 2):
                two = x[i : i + 2]
                level, noise, _ = self.fit.pair(point.p, *two)
                found.append((level[: len(two)], noise[: len(two)], self.fit.R[: len(two)].copy()))
            level, noise, residual = (np.concatenate(part) for part in zip(*found, strict=True))
            return level, noise, residual

        levels, noises, residuals = run([theta])
        level, noise, r = float(levels[0]), float(noises[0]), residuals[0]
        damping = 1e-3
        for _ in range(6):
            slopes = (r - run([theta + small * (np.arange(4) == i) for i in free])[2]) / small[free, None]
            weighted = slopes * ((T_FREEDOM + 1.0) / (T_FREEDOM + r * r / noise))
            H, g = weighted @ slopes.T, weighted @ r
            H += 1e-9 * np.trace(H) * np.eye(len(g)) + 1e-300 * np.eye(len(g))
            gained = 0.0
            for _ in range(4):
                trial = theta.copy()
                trial[free] += np.linalg.solve(H + damping * np.diag(np.diag(H)), g)
                trial[0] = np.clip(trial[0], least, most)
                if trial[1] > 0.0 and trial[3] > 1.0:
                    levels, noises, residuals = run([trial])
                    if levels[0] > level:
                        gained = float(levels[0]) - level
                        theta, level, noise, r = trial, float(levels[0]), float(noises[0]), residuals[0]
                        damping = max(damping / 5.0, 1e-6)
                        break
                damping *= 10.0
            if gained < LEAST_GAIN:
                break
        load = Wave(float(theta[1]), float(theta[3]), float(theta[2]))
        return replace(point, d=float(theta[0]), load=load, level=level)


def switching_load(rows: Rows) -> Wave | None:
    """Return the square load that OP seems to oppose, a start for the fit; None where there is none."""
    return opposed_wave(rows.x[0], rows.y, np.arange(len(rows.y)) if rows.at is None else rows.at)


def with_switching_load(rows: Rows, plain: Evidence, load: Wave) -> Evidence:
    """Return the evidence with an even square `load` in it, or the `plain` one where it does not explain PV better."""
    search = _Search(rows, load)
    none = search.start(load)
    asked = plain.worth + BETTER
    if none.level < asked - REACH:
        return plain
    at_widths = search.along_widths(none)
    if not at_widths:
        return plain
    play = search.polish(max(at_widths, key=lambda point: point.level))
    none = max(none, search.polish(replace(at_widths[0], d=0.0), d_free=False), key=lambda point: point.level)
    if max(none.level, play.level) < asked:
        return plain
    halves = []
    for width in (play.d, 1.5 * play.d, 2.0 * play.d):
        load = replace(play.load, amplitude=play.load.amplitude + 0.5 * max(play.d - 0.5 * width, 0.0))
        halves.append(search.polish(replace(play, d=width, load=load), part=0.5).level)
    return _evidence(search, none, play, max(halves), at_widths)


def _evidence(search: _Search, none: _Point, play: _Point, half: float, at_widths: list[_Point]) -> Evidence:
    fit, k = search.fit, search.fit.counted
    found = sorted([*((one.d, one.level) for one in at_widths), (play.d, play.level)])
    d, levels = np.array([one[0] for one in found]), np.array([one[1] for one in found])
    mirror = search.level(none, search.valve(play.d, -1.0)) - none.level
    fit.pair(none.p, search.position(none.load, search.rows.x[0]))
    without = float(np.median(fit.R[0, k] ** 2 * fit.S[k]))
    with_it = search.position(play.load, search.valve(play.d))
    level, noise, b = fit.pair(play.p, with_it, search.position(play.load, np.zeros_like(with_it)))
    reduction = 1.0 - float(np.median(fit.R[0, k] ** 2 * fit.S[k])) / without
    return Evidence(
        play.d, likelihood_interval(d, levels, play.level), play.level - none.level, half - none.level, mirror,
        reduction, float(np.sqrt(noise[0])), 0, int(k.sum()), float(level[0] - level[1]), float(b[0].sum()),
        tuple((float(a), float(v - none.level)) for a, v in found), max(play.level, none.level), play.load.half,
    )
