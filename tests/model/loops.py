"""Small loops for tests of the workbench: PV computed from OP by an independent, slow, plain simulation."""

from __future__ import annotations

import numpy as np

from backlash_cli.record import FloatArray, LoopSettings, Record, record_from_arrays


def steps(samples: int, seed: int = 0, low: float = 0.3, high: float = 0.7, hold: int = 60) -> FloatArray:
    """Return an output that moves to a new level every `hold` samples, with a little noise, (samples,)."""
    random = np.random.default_rng(seed)
    levels = random.uniform(low, high, samples // hold + 1)
    wave = 0.01 * np.sin(np.arange(samples) / 7.0)
    return np.repeat(levels, hold)[:samples] + wave + 0.001 * random.standard_normal(samples)


def gap(u: FloatArray, d: float) -> FloatArray:
    """Return the stem position behind a gap d, sample by sample."""
    out, x = np.empty_like(u), u[0]
    for k, v in enumerate(u):
        x = min(max(x, v - d / 2), v + d / 2)
        out[k] = x
    return out


def process(u: FloatArray, h: float, gain: float, lag: float, offset: float, delay: int = 0) -> FloatArray:
    """Return PV of a first-order process driven by held samples, sampled before the output of the same scan acts."""
    a, x = np.exp(-h / lag), u[0]
    out = np.empty_like(u)
    for k in range(len(u)):
        out[k] = gain * x + offset
        x = a * x + (1 - a) * u[max(k - delay, 0)]
    return out


def loop(
    *, d: float = 0.0, samples: int = 1500, h: float = 2.0, noise: float = 0.001, gain: float = 1.2, delay: int = 0,
    seed: int = 0, settings: LoopSettings | None = None, load: float = 0.0,
) -> Record:  # fmt: skip
    """Return a loop with a dead band d, a lag of 20 s, white noise and a random load of deviation `load`."""
    random = np.random.default_rng([seed, 7])
    u = steps(samples, seed)
    push = np.zeros(samples)
    for k in range(1, samples):
        push[k] = 0.97 * push[k - 1] + np.sqrt(1 - 0.97**2) * load * random.standard_normal()
    pv = process(gap(u, d) + push, h, gain, 20.0, -0.1, delay) + noise * random.standard_normal(samples)
    return record_from_arrays(0.5, pv, u, interval=h, loop="TIC1", settings=settings or LoopSettings(Ti=20.0))
