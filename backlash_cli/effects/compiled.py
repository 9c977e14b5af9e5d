"""Runs the steps of effects: compiled where numba can, as plain Python where it cannot.

All steps share one machine signature and reach the kernels as function pointers. A kernel is therefore compiled
once, not once per effect or combination of effects, and both kernels and steps are cached on disk.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numba
import numpy as np
from numba.core.errors import NumbaError

from ..kernels import STEP_SIGNATURE, run_steps
from ..record import FloatArray


@lru_cache(maxsize=256)
def compiled(step: Callable[..., float]) -> Any | None:
    """Return the machine version of a step, or None when it is beyond numba (then it runs as plain Python)."""
    if not hasattr(step, "__code__"):
        return None
    # without numba's reference counts a step runs four times as fast; a step that makes arrays cannot do without
    for cache, counts in ((True, False), (True, True), (False, False), (False, True)):
        options: dict[str, Any] = {"cache": cache, "_nrt": counts}
        try:
            return numba.njit(STEP_SIGNATURE, **options)(step)
        except NumbaError:
            if counts:
                return None
        except RuntimeError:
            # numba finds no folder for its cache when the step was typed at the prompt
            continue
    return None


def run(step: Callable[..., float], state: FloatArray, values: FloatArray, p: FloatArray) -> FloatArray:
    """Send (samples,) float64 through one step, changing `state` in place; returns (samples,)."""
    out = np.empty_like(values)
    machine = compiled(step)
    if machine is not None:
        run_steps(machine, state, values, p, out)
    else:
        for k, value in enumerate(values):
            out[k] = step(state, value, p)
    return out
