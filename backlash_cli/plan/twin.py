"""A loop for the desk out of its own record: controller, process, and what moved PV besides OP.

PV = process behind the valve (OP) + upset. The upset, load and noise together, is what the process leaves of the
record's own PV; it is played again in blocks drawn at random, so that loads that step, swing or wander stay what they
are. No model of a load is needed."""

import contextlib
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.signal import lfilter, ss2tf

from ..effects.loads import MEASURED_DISTURBANCE as ADDED
from ..effects.shape import Stage
from ..errors import LoopError
from ..estimator.predictor import recording_of
from ..kernels import play
from ..record import FloatArray, Frozen, Record
from ..simulator import Applied, Controller, Manual, Process, Recorder, Scenario, Signal, Trace, export, trace, use
from ..simulator.compensation import LEAST_MARGIN, gain_margin, model_of

HOLE = 20  # samples; a longer one ends the stretch that is played again
LONGEST = 200_000  # samples of it, the last ones
SHORTEST_BLOCK = 40.0  # integral times
BLOCKS = 5  # at least so many make up the stretch
FINEST = 15.0  # inner steps in an integral time
SEEN = 5.0  # integral times: the slowest lag a record in automatic tells; of slower ones only gain over lag is known
SPREAD, ASSUMED_SPREAD = 0.3, 0.4  # of gain, lag and dead time from repeat to repeat, as natural logarithms
SEVERAL = (4.0, 1.0, 1.0)  # weights of the lags that share the sum of those fitted, in a draw of Dirichlet's law
SETTLE = 12.0  # integral times that the simulated loop has before the record of it begins
TRIES = 5  # to draw a process that this controller can hold
# An assumed process has gain 1, as spans are chosen, and is tuned as Skogestad (J. Process Control 13, 2003) says:
# K = lag / (gain (closed + dead time)), Ti = min(lag, 4 (closed + dead time)); a level is one with a lag far beyond Ti
INTEGRAL, DEAD_TIME = 4.0, 0.2  # that 4, and the dead time as a share of closed-loop time constant and dead time
UNLIKE = 3.0  # times more or less than that answers no process in one integral time, whatever a fit says


class Move(Frozen):
    """A limit on a move: a share of the span, or in units of the loop."""

    size: float
    of_span: bool = True

    def share(self, span: tuple[float, float]) -> float:
        """The limit as a share of a span from low to high."""
        return self.size if self.of_span else self.size / abs(span[1] - span[0])


KINDS = ("wait", "setpoint_steps", "manual_test")  # the least trouble first
TENTH = Move(0.1)


class Test(Frozen):
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


class Twin(Frozen, eq=False):
    """What a loop is made of. d: dead band [span]. level, output: where PV and OP stood in the mean. upset: (samples,)
    what moves PV besides OP, setpoint: (samples,) less its level. spread: how well the process is known.
    rounding: steps to which the historian rounds PV and OP, 0 for not at all: samples that do not lie on the steps of
    those before them would look like values that were held."""

    record: Record
    d: float
    controller: Controller
    process: Process
    source: str
    spread: float
    level: float
    output: float
    setpoint: FloatArray
    upset: FloatArray
    rounding: tuple[float, float]

    @property
    def answer_time(self) -> float:
        """Time [s] that the process needs for most of its answer to a step of OP."""
        p = self.process
        return p.dead_time + (3.0 * sum(p.lags) if p.lags and not p.integrating else sum(p.lags))

    def settled(self, hold: float) -> float:
        """How far PV moves for a move of OP held so long [PV span per OP span]."""
        return answer(self.process, hold - self.process.dead_time)

    def play(self, test: Test, seed: int, *, around: float = 0.0) -> tuple[Record, Trace, float]:
        """Return what the historian would keep of a test, and the whole simulation with the time [s] of its start.

        around: ordinary operation [s] before the test and after it, in the record.
        Raises LoopError where the loop cannot be held stable."""
        for attempt in range(TRIES):
            with contextlib.suppress(LoopError):
                return self._play(test, np.random.default_rng([seed, attempt]), around, self.spread)
        return self._play(test, np.random.default_rng([seed, TRIES]), around, 0.0)

    def _play(self, test: Test, random: np.random.Generator, around: float, spread: float
              ) -> tuple[Record, Trace, float]:
        h, c = self.record.interval, self.controller
        inner = max(1, int(np.ceil(h * FINEST / c.Ti)))
        begin = max(1, round((SETTLE * c.Ti + around) / h)) * h
        samples = int(np.ceil((begin + test.duration + around) / h))
        gain, lag, dead = np.exp(spread * random.standard_normal(3))
        p = self.process
        lags = sum(p.lags) * lag * random.dirichlet(SEVERAL)  # a fit with one lag or two stands for a process of more
        process = replace(p, gain=p.gain * gain, lags=tuple(lags[lags > 0.0].tolist()), dead_time=p.dead_time * dead)
        process = replace(process, gain=process.gain * min(1.0, gain_margin(c, process) / LEAST_MARGIN))
        place = random.uniform(-1.0, 1.0)
        upset, setpoint = self._again(samples, random)
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
                           for name, step in zip(("PV", "OP"), self.rounding, strict=True) if step))
        if test.kind == "manual_test":
            stood = float(trace(replace(scenario, duration=begin)).output[-1])
            edges = begin + test.hold * np.arange(len(test.levels) + 1)
            scenario = replace(scenario, manual=tuple(Manual(a, b, float(np.clip(stood + test.move * level, 0.0, 1.0)))
                for a, b, level in zip(edges, edges[1:], test.levels, strict=False)))
        run = trace(scenario)
        record = replace(export(run), settings=self.record.settings)
        return record.slice(round((begin - around) / h), len(record)), run, begin

    def _again(self, samples: int, random: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """Draw upset and setpoint (samples,): blocks of the record's own, forward or backward, up or down, joined."""
        n = len(self.upset)
        size = int(min(n, max(n // BLOCKS, SHORTEST_BLOCK * self.controller.Ti / self.record.interval)))
        wanders = np.count_nonzero(np.diff(self.setpoint)) > 0.5 * n  # a cascade or a ramp: must not jump either
        parts: list[list[FloatArray]] = [[], []]
        for _ in range(-(-samples // size)):
            first, way, sign = random.integers(n - size + 1), 1 - 2 * random.integers(2), 1 - 2 * random.integers(2)
            for values, into, joined in ((self.upset, parts[0], True), (self.setpoint, parts[1], wanders)):
                block = sign * values[first : first + size][::way]
                if joined and into:
                    block = block + (into[-1][-1] - block[0]) * np.linspace(1.0, 0.0, size)
                into.append(block)
        upset, setpoint = (np.concatenate(p)[:samples] for p in parts)
        return upset - upset[0], setpoint


def added(values: FloatArray, stage: Stage) -> Applied:
    """An effect that adds values (samples,) to the signal that it meets, as a measured disturbance with gain 1."""
    effect = replace(ADDED, stage=stage, column=False, start=lambda p, h, first: np.append(0.0, values))
    return Applied(effect, np.array([1.0]))


def twins_of(record: Record, sizes: Sequence[float], rounding: tuple[float, float] = (0.0, 0.0)) -> tuple[Twin, ...]:
    """Make twins of a record whose settings hold K and Ti, as if its valve had each of these dead bands [span].

    They share the process: that of the dead band with which the record tells it best. Raises LoopError where OP was not
    recorded or no stretch of the record can be used."""
    if record.output is None:
        raise LoopError("no controller output (OP) in the data", where=record.loop, code="no_output")
    controller = Controller.of(record.settings, low=min(0.0, float(np.nanmin(record.output))),
                               high=max(1.0, float(np.nanmax(record.output))))
    process, source = _process(record, controller, sizes)
    stretch = longest_stretch(record)
    assert stretch.output is not None
    good = stretch.usable & np.isfinite(stretch.measurement)
    on_grid = recording_of(stretch.index, stretch.output, stretch.measurement, good)
    output, pv = on_grid.output, on_grid.measurement
    grid, at = np.arange(len(pv)), stretch.index - stretch.index[0]
    sp = np.interp(grid, at[good], np.nan_to_num(stretch.setpoint[good], nan=float(pv.mean())))
    mean = float(output.mean())
    upsets = [pv - response(process, play(output, d, float(output[0])) - mean, record.interval) for d in sizes]
    return tuple(Twin(record, d, controller, process, source, SPREAD if source == "fitted" else ASSUMED_SPREAD,
                      float(sp[-1]), mean, sp - sp[-1], upset - upset.mean(), rounding)
                 for d, upset in zip(sizes, upsets, strict=True))


def _process(record: Record, controller: Controller, sizes: Sequence[float]) -> tuple[Process, str]:
    """The process that explains PV best from OP, else one that its controller's tuning would suit."""
    models = []
    for d in sizes:
        with contextlib.suppress(LoopError):
            models.append(model_of(record, controller, d, None, integrating=True)[0])
    Ti, much = controller.Ti, abs(controller.K)
    assumed = Process(float(np.sign(controller.K)), (Ti * max(1.0, much / INTEGRAL),),
                      DEAD_TIME * Ti / float(np.clip(much, 1.0, INTEGRAL)))
    if not models:
        return assumed, "assumed to suit K and Ti"
    process = max(models, key=lambda model: model.evidence or 0.0)
    share = 1.0 if process.integrating else min(1.0, SEEN * Ti / max(sum(process.lags), 1e-9))
    # what comes later than a few integral times the controller has made up for: no record in automatic tells it
    process = replace(process, gain=process.gain * share, lags=tuple(x * share for x in process.lags))
    unlike = answer(process, Ti) / answer(assumed, Ti)
    return replace(process, gain=process.gain * float(np.clip(unlike, 1.0 / UNLIKE, UNLIKE)) / unlike), "fitted"


def answer(process: Process, time: float) -> float:
    """How far PV moves so long [s] after the dead time of a step of OP [PV span per OP span]."""
    part = time if process.integrating else 1.0 - float(np.exp(-time / max(sum(process.lags), 1e-9)))
    return abs(process.gain) * part if time > 0.0 else 0.0


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
    longest = max(np.split(good, np.flatnonzero(np.diff(record.index[good]) > HOLE) + 1), key=len)
    first, last = int(longest[0]), int(longest[-1]) + 1
    return record.slice(max(first, last - LONGEST), last)


def behind(record: Record, later: Record) -> Record:
    """One record: later samples of the same loop behind those of a record, with a hole between."""
    both: dict[str, Any] = {name: np.append(getattr(record, name), getattr(later, name))
                            for name in ("setpoint", "measurement", "output", "state")}
    index = np.append(record.index, later.index - later.index[0] + record.index[-1] + HOLE + 5)
    return replace(record, index=index, disturbances={}, notes=(), **both)
