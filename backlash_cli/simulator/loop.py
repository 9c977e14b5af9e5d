"""The closed loop on the desk: controller, valve effects, process, load, sensor; returns a Record like an export."""

import warnings
from collections.abc import Iterator, Mapping
from itertools import count
from typing import Any

import numpy as np

from ..effects.shape import Stage, compiled
from ..errors import LoopError, MetadataError, nearest
from ..record import BoolArray, FloatArray, Frozen, Record, SampleState
from ..words import explained
from .scenario import Applied, Scenario, Signal, draw_lines, every

UNSTABLE_SPANS = 10.0  # the measurement of a loop that works stays within a few spans
TOUCHES = 1e-9  # an output this close to its limit is at its limit
Random = Iterator[np.random.Generator]  # one after the other, for the random effects in their order


def series(applied: Applied, samples: int, columns: Mapping[str, FloatArray], random: Random) -> FloatArray:
    if applied.effect.draws:
        return next(random).standard_normal(applied.effect.draws * (samples + 1))
    if not applied.effect.column:
        return np.empty(0)
    if applied.column is None or applied.column not in columns:
        raise MetadataError(f"{applied.effect.name} needs a measured column, not '{applied.column}'",
                            remedy=nearest(str(applied.column), columns))
    return columns[applied.column]


def _effects(s: Scenario, samples: int, columns: Mapping[str, FloatArray], random: Random
             ) -> tuple[tuple[Any, ...], float, bool]:
    """Start every effect at rest, in the order a signal meets them.

    Returns what the kernel takes first (steps, where each state and parameters begin, the last effect of valve and
    process, of the load, of the sensor, states, parameters), the process input at rest, whether all steps compile."""
    from ..kernels import SLOTS

    order = list(Stage)
    chain = sorted(s.effects, key=lambda a: order.index(a.effect.stage))
    if len(chain) > SLOTS:
        raise MetadataError(f"{len(chain)} effects in one loop", where=s.name, remedy=f"at most {SLOTS}")
    value, rest, states = s.output, s.output, [np.empty(0)]
    for applied in chain:
        if applied.effect.stage is Stage.SENSOR:
            value = s.setpoint.level
        state = applied.effect.begin(applied.p, s.step, value, series(applied, samples, columns, random))
        states.append(state)
        if applied.effect.stage in order[:3]:
            value = rest = float(applied.effect.step(state.copy(), value, applied.p))
    ends = [sum(a.effect.stage in upto for a in chain) for upto in (order[:3], order[:4], order)]
    machine = [compiled(a.effect.step) for a in chain]
    ready = None not in machine
    steps = (*(machine if ready else [a.effect.step for a in chain]), *[compiled(_idle)] * (SLOTS - len(chain)))
    packed = [np.empty(0), *(a.p for a in chain)]
    return ((steps, np.cumsum([len(x) for x in states]), np.cumsum([len(x) for x in packed]),
             np.array(ends, dtype=np.int64), np.concatenate(states), np.concatenate(packed)), rest, ready)


def _idle(state: FloatArray, value: float, p: FloatArray) -> float:
    return value


class Trace(Frozen, eq=False):
    """Every signal of a simulated loop at the inner step, each (samples,), normalised.

    measurement: after sensor effects. output: of the controller, compensation included. valve: after valve effects,
    before the load. process_output: before sensor effects. error: ysp - yf as the controller sees it.
    by_hand: True in manual. columns: name -> further measured signals."""

    scenario: Scenario
    setpoint: FloatArray
    measurement: FloatArray
    output: FloatArray
    valve: FloatArray
    process_output: FloatArray
    error: FloatArray
    by_hand: BoolArray
    columns: Mapping[str, FloatArray]

    @property
    def time(self) -> FloatArray:
        """(samples,) seconds from the start."""
        return self.scenario.step * np.arange(len(self.setpoint), dtype=np.float64)


def simulate(scenario: Scenario) -> Record:
    """Simulate a loop and return the Record that a historian would export; raises as `trace` does."""
    return export(trace(scenario))


def export(run: Trace) -> Record:
    """Return what the historian keeps of a simulation: every n-th sample, through the recorder."""
    s = run.scenario
    pick = slice(None, None, every(s.record_seconds, s.step, "record_interval"))
    output = run.output[pick]
    limited = (output <= s.controller.low + TOUCHES) | (output >= s.controller.high - TOUCHES)
    state = np.where(limited, SampleState.SATURATED, SampleState.GOOD).astype(np.uint8)
    state[run.by_hand[pick]] = SampleState.MANUAL
    signals = {"SP": run.setpoint[pick].copy(), "PV": run.measurement[pick].copy(), "OP": output.copy()}
    for recorder in s.recorder:
        for name in recorder.signals:
            kept = recorder.applied.effect.apply(signals[name], recorder.applied.p, s.record_seconds)
            signals[name] = draw_lines(signals[name], kept) if recorder.lines else kept
    return Record(loop=s.name, start=s.start, interval=s.record_seconds, index=np.arange(output.size, dtype=np.int64),
                  setpoint=signals["SP"], measurement=signals["PV"], output=signals["OP"], state=state,
                  settings=s.settings, disturbances={name: values[pick].copy() for name, values in run.columns.items()})


def trace(scenario: Scenario) -> Trace:
    """Simulate a loop and return every signal at the inner step, the true valve position included. Raises LoopError
    (code `unstable_loop`) when the measurement runs away."""
    from ..kernels import COMPENSATOR_STATE, PID_STATE, closed_loop

    s, c = scenario, scenario.controller
    samples = max(round(s.duration / s.step), 1)
    random = (np.random.default_rng([s.seed, k]) for k in count(1))
    setpoint = _from_outside(s.setpoint, samples, s.step, random)
    columns = {name: _from_outside(signal, samples, s.step, random) for name, signal in s.columns.items()}
    by_hand, hand = _manual(s, samples)
    effects, rest, ready = _effects(s, samples, columns, random)
    start, (*process, delay) = s.setpoint.level, s.process.sampled(s.step)
    pid_state, comp_state, out = np.zeros(PID_STATE), np.zeros(COMPENSATOR_STATE), np.zeros((5, samples))
    pid_state[:4], pid_state[4], pid_state[6] = start, s.output - c.K * (c.b - 1.0) * start, s.output
    if s.compensator.scheme not in (0, 9):
        comp_state[:3] = s.output
    run = closed_loop if ready else closed_loop.py_func
    with warnings.catch_warnings(), np.errstate(over="ignore", invalid="ignore"):
        warnings.filterwarnings("ignore", message="First-class function type feature")
        reached = run(*effects, *process, np.zeros(delay + 2), c.packed(s.sample_seconds), pid_state,
                      s.compensator.packed(c, s.sample_seconds), comp_state, every(s.sample_seconds, s.step,
                      "sample_time"), setpoint, by_hand, hand, start, rest, UNSTABLE_SPANS, out)
    if reached < samples or not np.all(np.isfinite(out)):
        raise LoopError(**explained("unstable_loop", seconds=reached * s.step), where=s.name)
    measurement, output, valve, process_output, error = out
    return Trace(s, setpoint, measurement, output, valve, process_output, error, by_hand, columns)


def _from_outside(signal: Signal, samples: int, step: float, random: Random) -> FloatArray:
    values = np.full(samples, float(signal.level))
    for applied in signal.effects:
        values = applied.effect.apply(values, applied.p, step, first=signal.level,
                                      series=series(applied, samples, {}, random))
    return values


def _manual(s: Scenario, samples: int) -> tuple[BoolArray, FloatArray]:
    by_hand, hand = np.zeros(samples, dtype=np.bool_), np.full(samples, np.nan)
    for spell in s.manual:
        if not 0.0 <= spell.start < spell.end:
            raise MetadataError(f"manual from {spell.start:g} to {spell.end:g} s is not possible", where=s.name)
        first, last = (round(t / s.step) for t in (spell.start, min(spell.end, s.duration)))
        by_hand[first:last] = True
        if spell.output is not None:
            hand[first:last] = spell.output
    return by_hand, hand
