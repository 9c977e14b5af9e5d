"""The one shape of a physical effect.

An effect is a `step` for one sample and an EFFECT record that describes it. `step(state, value, p)` takes the
effect's state (1-D float64 array, changed in place), one input sample and the parameters (1-D float64 array in the
order of EFFECT.parameters) and returns one output sample. It is plain Python within numba's subset (beyond it: slower,
same result), so that the same lines run one sample at a time in the closed loop and compiled over whole arrays when a
model is fitted. Compiled steps share one machine signature and reach the kernels as function pointers, so that a kernel
is compiled once, not once per combination of effects.

`start(p, interval, first)` makes the state before the first sample: `interval` seconds between samples, `first` the
signal that stood at the effect's input for a long time before. A signal is held between samples (zero-order hold);
where an effect moves inside a sample interval its output sample is the mean over that interval.

At its neutral values an effect returns its input bit for bit, so models nest and "off" needs no class."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import field, replace
from enum import StrEnum
from functools import lru_cache
from typing import Any

import msgspec
import numpy as np

from ..errors import MetadataError, nearest
from ..record import FloatArray, Frozen
from ..words import Words
from .fitting import Fitting

_TOLD = Words(__package__).tables
Start = Callable[[FloatArray, float, float], FloatArray]
Step = Callable[[FloatArray, float, FloatArray], float]


class Stage(StrEnum):
    """Where on the way from controller to historian an effect sits, in the order a signal meets them."""

    COMMAND = "command"
    VALVE = "valve"
    PROCESS = "process"
    LOAD = "load"
    SENSOR = "sensor"


class Parameter(Frozen):
    """One number (or, with `many`, a list of numbers) of an effect.

    low, high: physical bounds. neutral: value at which the effect does nothing, also used when a value is left out.
    start: values worth starting a fit from. nuisance: says how the record began, not what is wrong with the loop.
    choices: the only values allowed, for switches."""

    name: str
    unit: str
    meaning: str
    neutral: float
    low: float
    high: float
    start: tuple[float, ...] = ()
    many: bool = False
    nuisance: bool = False
    choices: tuple[float, ...] = ()


class Effect(Frozen):
    """What a reader, a fit and the simulator need to know about one physical effect.

    column: the effect also takes the samples of one measured column, (samples,).
    draws: standard normal numbers it takes per sample (random effects); the series then holds draws * (samples + 1).
    fitted: may be looked for in measurements; False for what only the simulator plays.
    fitting: how a fit starts and refines it; the default serves an effect on the way of the output."""

    name: str
    stage: Stage
    sentence: str
    source: str
    parameters: tuple[Parameter, ...]
    start: Start
    step: Step
    column: bool = False
    draws: int = 0
    fitted: bool = True
    fitting: Fitting = field(default_factory=Fitting)

    def pack(self, values: Mapping[str, object] | None = None, **more: object) -> FloatArray:
        """Return the parameter array for named values; what is left out is neutral (a list left out is empty).

        Raises MetadataError for an unknown name, a value outside its bounds, or lists of different length."""
        given = {**(values or {}), **more}
        known = [q.name for q in self.parameters]
        for name in [name for name in given if name not in known]:
            raise MetadataError(f"{self.name} has no parameter '{name}'", remedy=nearest(name, known))
        parts = [self._values(q, given.get(q.name)) for q in self.parameters]
        lengths = {len(part) for part, q in zip(parts, self.parameters, strict=True) if q.many}
        if len(lengths) > 1:
            names = " and ".join(q.name for q in self.parameters if q.many)
            raise MetadataError(f"{self.name}: {names} differ in length", remedy="give one value of each per event")
        return np.concatenate([np.empty(0), *parts])

    def _values(self, q: Parameter, given: object) -> FloatArray:
        if given is None:
            return np.empty(0) if q.many else np.array([q.neutral])
        where, remedy = f"{self.name}.{q.name}", f"{q.meaning} [{q.unit}], {q.low:g} to {q.high:g}"
        try:
            array = np.atleast_1d(np.asarray(given, dtype=np.float64))
        except (TypeError, ValueError):
            raise MetadataError(f"'{given}' is not a number", where=where, remedy=remedy) from None
        if array.ndim != 1 or (not q.many and array.size != 1):
            raise MetadataError(f"{given} is not {'a list of numbers' if q.many else 'one number'}", where=where)
        allowed = np.isin(array, q.choices) if q.choices else (array >= q.low) & (array <= q.high)
        if not np.all(allowed):
            raise MetadataError(f"{array[~allowed][0]:g} is not possible", where=where, remedy=remedy)
        return array

    @property
    def neutral(self) -> FloatArray:
        """Parameter array at which the effect returns its input bit for bit."""
        return self.pack()

    def begin(self, p: FloatArray, interval: float, first: float, series: Sequence[float] | FloatArray = ()
              ) -> FloatArray:
        """Return the state before the first sample; `series` are the column's samples or the random numbers."""
        return np.concatenate([self.start(p, interval, first), series], dtype=np.float64)

    def run(self, state: FloatArray, values: object, p: FloatArray) -> FloatArray:
        """Send (samples,) through the effect from `state`, which is changed in place; returns (samples,)."""
        from ..kernels import run_steps
        array = np.ascontiguousarray(values, dtype=np.float64)
        if (machine := compiled(self.step)) is None:
            return np.array([self.step(state, value, p) for value in array])
        out = np.empty_like(array)
        run_steps(machine, state, array, p, out)
        return out

    def apply(self, values: object, p: FloatArray, interval: float, *, first: float | None = None,
              series: Sequence[float] | FloatArray = ()) -> FloatArray:
        """Return (samples,) after the effect; equal to `step` run over the samples one by one.

        values: (samples,) normalised signal. first: signal before the record, default its first sample."""
        array = np.ascontiguousarray(values, dtype=np.float64)
        if array.size == 0:
            return array.copy()
        return self.run(self.begin(p, interval, array[0] if first is None else first, series), array, p)


@lru_cache(maxsize=256)
def compiled(step: Callable[..., float]) -> Any | None:
    """Return the machine version of a step, or None when it is beyond numba (then it runs as plain Python)."""
    import numba
    from numba.core.errors import NumbaError

    from ..kernels import STEP_SIGNATURE
    # without numba's reference counts a step runs four times as fast; a step that makes arrays cannot do without
    options: list[dict[str, Any]] = [{"cache": cache, "_nrt": counts} for cache in (True, False)
                                     for counts in (False, True)]
    for option in options if hasattr(step, "__code__") else ():
        with suppress(NumbaError, RuntimeError):  # numba finds no folder for its cache for a step typed at the prompt
            return numba.cfunc(STEP_SIGNATURE, **option)(step)
    return None


def effect(name: str, stage: Stage, start: Start, step: Step, fitting: Fitting | None = None, **more: Any) -> Effect:
    """Return an effect of the project, with the sentence, the numbers, the source and the meaning that words.toml has
    for it. more: further fields of an Effect."""
    if fitting is not None:
        more["fitting"] = replace(fitting, meaning=_TOLD["meaning"][name])
    parameters = tuple(msgspec.convert(entry, Parameter) for entry in _TOLD["parameters"][name])
    return Effect(name, stage, _TOLD["sentence"][name], _TOLD["source"][name], parameters, start, step, **more)
