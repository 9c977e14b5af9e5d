"""A loop for the desk out of its own record: controller, process, and what moved PV besides OP.

PV = process behind the valve (OP) + upset. Nobody knows the process exactly: each repeat draws one of those that the
record and the tuning of its controller allow. The upset, load and noise together, is what this process leaves of the
record's own PV; it is played again in blocks drawn at random, so that loads that step, swing or wander stay what they
are. No model of a load is needed.
"""

from __future__ import annotations

import contextlib
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.signal import lfilter, ss2tf

from ..effects.loads import MEASURED_DISTURBANCE as ADDED
from ..effects.shape import Stage
from ..errors import LoopError
from ..estimator.predictor import recording_of
from ..kernels import play
from ..record import FloatArray, Record
from ..simulator import Applied, Controller, Manual, Process, Recorder, Scenario, Signal, Trace, export, trace, use
from ..simulator.compensation import LEAST_MARGIN, gain_margin
from ..simulator.process_fit import LEAST_EVIDENCE, SECOND, prepared, spread

HOLE = 20  # samples; a longer one ends the stretch that is played again
LONGEST = 200_000  # samples of it, the last ones
SHORTEST_BLOCK = 40.0  # integral times
BLOCKS = 5  # at least so many make up the stretch
FINEST = 15.0  # inner steps in an integral time
SETTLE = 12.0  # integral times that the simulated loop has before the record of it begins
FEWEST = 100  # blocks of a record that tell something of its process
# what a tuning tells of a process, medians and spreads as natural logarithms: Ti over the loop's time constant, that is
# K gain Ti/lag, about 1 by lambda tuning, and 4 at least for an integrator that is not to swing (Skogestad 2003); lag
# over Ti; dead time over the loop's time constant
TUNED, TUNED_LEVEL, LAG, DEAD_TIME = (1.2, 0.7), (10.0, 0.7), (1.0, 0.4), (0.3, 0.5)
INTEGRATOR = 40.0  # lag over Ti that stands for an integrator
LEVEL, INTEGRATES = r"(?<![A-Za-z])L[A-Z]?C", (0.1, 0.9)  # names of level loops (ISA-5.1); chance of an integrator
TRIED, DRAWS, SPREAD = 1000, 100, 0.2  # processes tried, drawn; the drawn differ a little, as natural logarithms
COUNTS, TRUST = 0.02, 0.5  # of a block of the record as evidence: loads are never as white as they are made; of the fit


@dataclass(frozen=True)
class Move:
    """A limit on a move: a share of the span, or in units of the loop."""

    size: float
    of_span: bool = True

    def share(self, span: tuple[float, float]) -> float:
        """The limit as a share of a span from low to high."""
        return self.size if self.of_span else self.size / abs(span[1] - span[0])


KINDS = ("wait", "setpoint_steps", "manual_test")  # the least trouble first
TENTH = Move(0.1)


@dataclass(frozen=True)
class Test:
    """kind: wait, setpoint_steps or manual_test. levels: of SP or OP one after the other, in moves [span], each held
    for hold [s]. A wait has one level of no move."""

    kind: str
    hold: float
    move: float = 0.0
    levels: tuple[float, ...] = (0.0,)

    @property
    def duration(self) -> float:
        """How long it takes [s]."""
        return self.hold * len(self.levels)

    def course(self, time: FloatArray) -> FloatArray:
        """The move [span] at times [s] from its start, (samples,); none before and after."""
        at = np.floor(time / self.hold).astype(np.int64)
        within = (at >= 0) & (at < len(self.levels))
        return np.where(within, self.move * np.array(self.levels)[at.clip(0, len(self.levels) - 1)], 0.0)


@dataclass(frozen=True, eq=False)
class Twin:
    """What a loop is made of. d: dead band [span]. process: the likeliest, draws: as likely as record and tuning make
    them. level, output: where PV and OP stood in the mean. stem, measurement: (samples,) of the record, the stem
    less its mean; setpoint: (samples,) less its level.
    rounding: steps to which the historian rounds PV and OP, 0 for not at all: samples that do not lie on the steps of
    those before them would look like values that were held."""

    record: Record
    d: float
    controller: Controller
    process: Process
    draws: tuple[Process, ...]
    source: str
    level: float
    output: float
    stem: FloatArray
    measurement: FloatArray
    setpoint: FloatArray
    rounding: tuple[float, float]

    @property
    def answer_time(self) -> float:
        """Time [s] that the process needs for most of its answer to a step of OP."""
        p = self.process
        return p.dead_time + (3.0 * sum(p.lags) if p.lags and not p.integrating else sum(p.lags))

    def settled(self, hold: float) -> float:
        """How far PV moves for a move of OP held so long [PV span per OP span]."""
        gain, p = abs(self.process.gain), self.process
        acts = max(hold - p.dead_time, 0.0)
        return gain * (acts if p.integrating else 1.0 - float(np.exp(-acts / max(sum(p.lags), 1e-9))))

    def upset(self, process: Process) -> FloatArray:
        """What moves PV besides OP, (samples,), if this is the process."""
        left = self.measurement - response(process, self.stem, self.record.interval)
        return np.asarray(left - left.mean())

    def play(self, test: Test, seed: int, *, around: float = 0.0) -> tuple[Record, Trace, float]:
        """Return what the historian would keep of a test, and the whole simulation with the time [s] of its start.

        around: ordinary operation [s] before the test and after it, in the record. Raises LoopError where the loop
        cannot be held stable.
        """
        random, h, c = np.random.default_rng(seed), self.record.interval, self.controller
        inner = max(1, int(np.ceil(h * FINEST / c.Ti)))
        begin = max(1, round((SETTLE * c.Ti + around) / h)) * h
        samples = int(np.ceil((begin + test.duration + around) / h))
        process = self.draws[random.integers(len(self.draws))]
        place = random.uniform(-1.0, 1.0)
        upset, setpoint = self._again(process, samples, random)
        # proportional action on the error or on PV alone: nobody wrote down which, so half of the repeats have each
        controller = replace(c, b=float(random.integers(2)))
        setpoint = setpoint if test.kind == "wait" else np.zeros(samples)
        if test.kind == "setpoint_steps":
            setpoint = setpoint + test.course(h * np.arange(samples, dtype=np.float64) - begin)
        scenario = Scenario(
            controller, process, samples * h, h / inner,
            (use("backlash", d=self.d, position=place), added(np.repeat(upset, inner), Stage.SENSOR)),
            Signal(self.level, (added(np.repeat(setpoint, inner), Stage.LOAD),)), self.output, record_interval=h,
            sample_time=h / inner, name=self.record.loop,
            recorder=tuple(Recorder(use("quantization", step=step), (name,))
                           for name, step in zip(("PV", "OP"), self.rounding, strict=True) if step),
        )
        if test.kind == "manual_test":
            before = replace(scenario, duration=begin)
            stood = float(trace(before).output[-1])
            edges = begin + test.hold * np.arange(len(test.levels) + 1)
            scenario = replace(scenario, manual=tuple(
                Manual(a, b, float(np.clip(stood + test.move * level, 0.0, 1.0)))
                for a, b, level in zip(edges, edges[1:], test.levels, strict=False)))
        run = trace(scenario)
        record = replace(export(run), settings=self.record.settings)
        return record.slice(round((begin - around) / h), len(record)), run, begin

    def _again(self, process: Process, samples: int, random: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """Draw upset and setpoint (samples,): blocks of the record's own, forward or backward, up or down, each
        joined to the one before it. What an integrator adds up, its load, is drawn before it is added up."""
        own = self.upset(process)
        own = np.diff(own, prepend=own[0]) if process.integrating else own
        n, per = len(own), max(1, round(self.controller.Ti / self.record.interval))
        size = min(n, max(n // BLOCKS, round(SHORTEST_BLOCK * per)))
        near = min(per, size) if process.integrating else 1  # samples that tell where a block begins or ends
        wanders = np.count_nonzero(np.diff(self.setpoint)) > 0.5 * n  # a cascade or a ramp: must not jump either
        parts: list[list[FloatArray]] = [[], []]
        for _ in range(-(-samples // size)):
            first, way, sign = random.integers(n - size + 1), 1 - 2 * random.integers(2), 1 - 2 * random.integers(2)
            for values, into, joined in ((own, parts[0], True), (self.setpoint, parts[1], wanders)):
                block = sign * values[first : first + size][::way]
                if joined and into:
                    block = block + (into[-1][-near:].mean() - block[:near].mean()) * np.linspace(1.0, 0.0, size)
                into.append(block)
        upset, setpoint = (np.concatenate(p)[:samples] for p in parts)
        upset = np.cumsum(upset) if process.integrating else upset
        return upset - upset[0], setpoint


def added(values: FloatArray, stage: Stage) -> Applied:
    """An effect that adds values (samples,) to the signal that it meets, as a measured disturbance with gain 1."""
    effect = replace(ADDED, stage=stage, column=False, start=lambda p, h, first: np.append(0.0, values))
    return Applied(effect, np.array([1.0]))


def twins_of(record: Record, sizes: Sequence[float], rounding: tuple[float, float] = (0.0, 0.0)) -> tuple[Twin, ...]:
    """Make twins of a record whose settings hold K and Ti, as if its valve had each of these dead bands [span].

    Each has the processes that the record allows with its dead band. Raises LoopError where OP was not
    recorded or no stretch of the record can be used.
    """
    if record.output is None:
        raise LoopError("no controller output (OP) in the data", where=record.loop, code="no_output")
    controller = Controller.of(record.settings, low=min(0.0, float(np.nanmin(record.output))),
                               high=max(1.0, float(np.nanmax(record.output))))
    stretch = longest_stretch(record)
    assert stretch.output is not None
    good = stretch.usable & np.isfinite(stretch.measurement)
    on_grid = recording_of(stretch.index, stretch.output, stretch.measurement, good)
    output, pv = on_grid.output, on_grid.measurement
    grid, at = np.arange(len(pv)), stretch.index - stretch.index[0]
    sp = np.interp(grid, at[good], np.nan_to_num(stretch.setpoint[good], nan=float(pv.mean())))
    mean, twins = float(output.mean()), []
    for d in sizes:
        process, draws, source = _processes(record, controller, d)
        stem = play(output, d, float(output[0])) - mean
        twins.append(Twin(record, d, controller, process, draws, source, float(sp[-1]), mean, stem, pv, sp - sp[-1],
                          rounding))
    return tuple(twins)


def _processes(record: Record, controller: Controller, d: float) -> tuple[Process, tuple[Process, ...], str]:
    """The likeliest process behind a dead band d, draws from all of a grid by their likelihood, and where that is from.

    Bayes: what suits the tuning is likely beforehand, and what explains PV becomes so, in part: a loop whose setpoint
    rests is not identifiable, any process explains PV with the load that fits it (Ljung, System Identification, 2nd
    ed., section 13.4), and fits of such loops were off by factors of three.
    """
    c, told = controller, record.settings.Kp if record.settings.source.get("Kp") == "metadata" else None
    random = np.random.default_rng(0)

    def about(median: float | FloatArray, width: float) -> FloatArray:
        return np.asarray(median * np.exp(width * random.standard_normal(TRIED)))

    integrates = random.random(TRIED) < INTEGRATES[re.search(LEVEL, record.loop) is not None] * (not told)
    lag = np.where(integrates, INTEGRATOR, about(*LAG))
    slope = abs(c.K * told) / lag if told else np.where(integrates, about(*TUNED_LEVEL), about(*TUNED))
    shapes = np.column_stack([lag, lag * random.choice(SECOND, TRIED) * ~integrates, about(*DEAD_TIME) / slope])
    gains, weights, source = slope * lag / c.K, np.full(TRIED, 1.0 / TRIED), "assumed to suit K and Ti"
    with contextlib.suppress(LoopError):
        fit, best = prepared(record, d, told, FEWEST)
        along, power = fit.table(c.Ti * shapes).T / spread(fit.match(best)[2]) ** 2
        explained = COUNTS * gains * (along - 0.5 * gains * power)
        if explained.max() > COUNTS * LEAST_EVIDENCE:
            likely, source = np.exp(explained - explained.max()), "fitted"
            weights = TRUST * likely / likely.sum() + (1.0 - TRUST) * weights
    kind = integrates == (weights @ integrates > 0.5)
    several = np.log(np.column_stack([np.abs(gains), shapes[:, :2].sum(1), shapes[:, 2]]))[kind]
    gain, lag_sum, dead = np.exp(np.average(several, axis=0, weights=weights[kind]))
    draws = random.choice(TRIED, DRAWS, p=weights)
    by = np.exp(SPREAD * random.standard_normal((DRAWS, 3)))
    middle = _process(np.sign(c.K) * gain, np.array([lag_sum, 0.0, dead]), c.Ti)
    drawn = [_process(gains[k] * x, shapes[k] * [y, y, z], c.Ti) for k, (x, y, z) in zip(draws, by, strict=True)]
    return middle, tuple(p for p in drawn if gain_margin(c, p) >= LEAST_MARGIN) or (middle,), source


def _process(gain: float, shape: FloatArray, Ti: float) -> Process:
    """The process of a gain and a shape in integral times; a lag of very many stands for an integrator."""
    lags, integrating = [Ti * lag for lag in shape[:2].tolist() if lag > 1e-3], shape[0] > 0.5 * INTEGRATOR
    if integrating:
        gain /= lags.pop(0)
    return Process(float(gain), tuple(lags), float(shape[2]) * Ti, bool(integrating))


def response(process: Process, values: FloatArray, interval: float) -> FloatArray:
    """Return the answer (samples,) of a process at rest to an input held over each interval."""
    decay, new, old, readout, delay = process.sampled(interval)
    rest, inputs = 0.0 if process.integrating else values[0], np.column_stack([new, old])
    (newer, poles), (older, _) = (ss2tf(decay, inputs, readout[None], np.zeros((1, 2)), k) for k in range(2))
    out = lfilter(np.append(newer, 0.0) + np.append(0.0, older), poles, values - rest)
    return np.append(np.zeros(delay), out)[: len(values)] + process.gain * rest


def longest_stretch(record: Record) -> Record:
    """The longest stretch of a record without a long hole, at most LONGEST samples of it."""
    good = np.flatnonzero(record.usable & np.isfinite(record.measurement))
    if len(good) < 2:
        raise LoopError("no sample of the record can be used", where=record.loop, code="no_usable_data")
    cuts = np.flatnonzero(np.diff(record.index[good]) > HOLE)
    edges = np.concatenate([[0], cuts + 1, [len(good)]])
    k = int(np.argmax(np.diff(edges)))
    first, last = int(good[edges[k]]), int(good[edges[k + 1] - 1]) + 1
    return record.slice(max(first, last - LONGEST), last)


def behind(record: Record, later: Record) -> Record:
    """One record: later samples of the same loop behind those of a record, with a hole between."""
    both: dict[str, Any] = {name: np.append(getattr(record, name), getattr(later, name))
                            for name in ("setpoint", "measurement", "output", "state")}
    index = np.append(record.index, later.index - later.index[0] + record.index[-1] + HOLE + 5)
    return replace(record, index=index, disturbances={}, notes=(), **both)
