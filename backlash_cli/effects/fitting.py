"""What a fit needs to know about an effect beyond its physics: where to start, what is linear, what it looks like.

A `Fitting` is data, so that a fit never asks for an effect by name and a user's own effect takes part like the rest."""

from collections.abc import Callable, Mapping, Sequence

from ..record import BoolArray, FloatArray, Frozen

Values = Mapping[str, float | tuple[float, ...]]


class Clues(Frozen, eq=False):
    """What is known about the loop when start values are proposed; times in seconds from the first sample.

    output: (samples,) signal that enters the effect. measurement: (samples,), used: (samples,) bool where it counts.
    interval: between samples. lag: time constant of the process. duration: length of the record.
    known: what other effects came to when they were tried alone, name -> parameter values.
    step_times(count): sets of 1..count times at which a step load explains most of what the model misses.
    periods(count): the periods of the `count` strongest lines in what the model misses."""

    output: FloatArray
    measurement: FloatArray
    used: BoolArray
    interval: float
    lag: float
    duration: float
    known: Mapping[str, Values]
    step_times: Callable[[int], list[tuple[float, ...]]]
    periods: Callable[[int], list[float]]


Propose = Callable[[Clues], Sequence[Values]]
Whole = Callable[[FloatArray, FloatArray, float], FloatArray]
Interval = Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]


class Fitting(Frozen):
    """How an effect takes part in a fit.

    linear: parameters in which the effect adds in proportion; they are solved for, not searched. phase: parameter that
    turns a linear swing, solved for together with the amplitude. fixed: parameters that stay as proposed.
    propose: start values from the data; default are the `start` values of the parameters, in all combinations.
    dear: parameters picked from the whole record, such as the time of an event or the period of a line: among so
    many places something always looks good, so they cost more.
    search: "smooth" parameters are refined by slopes only; "jumpy" ones also by random trials, because the error has
    narrow valleys. siblings: names of effects that look much alike.
    rivals: names of effects of another kind that must do clearly worse in its place before this one is called clear.
    bounds: (measurement, parameters) -> lowest and highest true value of each sample, for effects of the recorder.
    meaning: what it means in the plant, with {name} of parameters.
    whole: (values, parameters, interval) -> (samples,), a faster way to the same result as `step` over all samples.
    on_loads: what loads add goes through this effect as well, as it does through a lag of the process, but not
    through a delay on the way from the valve.
    plausible: (values, travel) -> False for fitted values that a search should not believe; travel(t) is how far OP
    went around t seconds, infinite where it was held.
    seldom: tried only where the usual effects leave more than noise and load, and never more than "acts like"."""

    linear: tuple[str, ...] = ()
    phase: str = ""
    propose: Propose | None = None
    fixed: tuple[str, ...] = ()
    dear: tuple[str, ...] = ()
    search: str = "smooth"
    siblings: tuple[str, ...] = ()
    rivals: tuple[str, ...] = ()
    bounds: Interval | None = None
    meaning: str = ""
    whole: Whole | None = None
    on_loads: bool = False
    plausible: Callable[[Values, Callable[[float], float]], bool] | None = None
    seldom: bool = False
