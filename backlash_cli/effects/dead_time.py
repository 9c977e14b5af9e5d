"""Dead time: the process answers only after the material has travelled, for example along a pipe.

Any theta >= 0. With theta = (n + f) samples the delayed, held signal changes inside the sample interval; the output
sample is its mean over the interval, (1 - f) u[k-n] + f u[k-n-1].

>>> p = EFFECT.pack(theta=1.25)
>>> EFFECT.apply([0.0, 1.0, 1.0, 1.0, 0.0], p, interval=1.0).tolist()
[0.0, 0.0, 0.75, 1.0, 1.0]
"""

from __future__ import annotations

import numpy as np

from ..errors import MetadataError
from ..record import FloatArray
from .fitting import Clues, Fitting, Values
from .shape import Effect, Parameter, Stage

# delayed samples are kept in memory
MOST_SAMPLES = 10_000_000


def start(p: FloatArray, interval: float, first: float) -> FloatArray:
    """State: [next place in the ring, fraction f, ring of the last n + 1 inputs]."""
    samples = p[0] / interval
    if samples > MOST_SAMPLES:
        raise MetadataError(f"a dead time of {p[0]:g} s is {samples:.0f} samples", remedy="sample more coarsely")
    # a theta written as k intervals must not turn into k - 1 intervals and a fraction of 1 - 1e-16
    whole = np.floor(samples + 1e-9)
    return np.concatenate([[0.0, max(samples - whole, 0.0)], np.full(int(whole) + 1, first)])


def step(state: FloatArray, value: float, p: FloatArray) -> float:
    """Return the delayed signal for one sample."""
    if p[0] == 0.0:
        return value
    size = state.size - 2
    place = int(state[0])
    fraction = state[1]
    older = state[2 + place]
    state[2 + place] = value
    place = (place + 1) % size
    state[0] = place
    newer = state[2 + place]
    if fraction == 0.0:
        return newer
    return newer + fraction * (older - newer)


def whole(values: FloatArray, p: FloatArray, interval: float) -> FloatArray:
    """Return the delayed signal for all samples."""
    return values if p[0] == 0.0 else late(values, p[0] / interval)


def late(values: FloatArray, samples: float) -> FloatArray:
    """Return a signal (samples,) delayed by any number of samples; before the first it was constant."""
    whole = int(np.floor(samples + 1e-9))
    part = max(samples - whole, 0.0)
    n = len(values)
    out = np.full(n, values[0])
    if whole < n:
        out[whole:] = values[: n - whole]
    if part > 0.0 and whole + 1 < n:
        out[whole + 1 :] += part * (values[: n - whole - 1] - values[1 : n - whole])
    return out


def propose(clues: Clues) -> list[Values]:
    """Return delays from a tenth of the process lag to twice the lag."""
    return [{"theta": share * clues.lag} for share in (0.1, 0.25, 0.5, 0.8, 1.2, 2.0)]


EFFECT = Effect(
    name="dead_time",
    stage=Stage.PROCESS,
    sentence="Dead time: nothing happens at the measurement until a transport delay has passed.",
    source="Transport delay exp(-s theta), sampled as in Astrom and Wittenmark, Computer-Controlled Systems (1997)",
    parameters=(Parameter("theta", "s", "dead time", 0.0, 0.0, 1e6, (1.0, 5.0, 20.0, 60.0)),),
    start=start,
    step=step,
    fitting=Fitting(
        whole=whole,
        propose=propose,
        siblings=("second_lag",),
        meaning="The process answers {theta} after the valve moves. Give the dead time in the loop's settings and "
        "check the tuning; look for long pipes, slow analysers and sample lines.",
    ),
)
