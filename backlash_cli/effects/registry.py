"""Finds an effect by name: the project's own, installed ones (entry points), or `module:NAME` from a user's file."""

import importlib
import os
import sys
import traceback
from functools import lru_cache

import numpy as np

from ..errors import MetadataError, nearest
from ..words import explained
from . import EFFECTS
from .shape import Effect, Stage

GROUP = "backlash.effects"
TRIAL = 50  # samples of the signal that an effect from outside is tried on


def load_effect(name: str) -> Effect:
    """Return the effect called `name`, or the one that `module:NAME` points to.

    Raises MetadataError when there is none, or when what is found has not the shape of an effect."""
    if ":" in name:
        return _from_module(name)
    known = {effect.name: effect for effect in all_effects()}
    if name not in known:
        raise MetadataError(**explained("no_effect", effect=name, near=nearest(name, known)))
    return known[name]


@lru_cache(maxsize=1)
def all_effects() -> tuple[Effect, ...]:
    """Return the project's effects in the order a signal meets them, then those of installed packages."""
    from importlib.metadata import entry_points

    return (*EFFECTS, *(_from_module(point.value) for point in sorted(entry_points(group=GROUP), key=lambda e: e.name)))


def _from_module(name: str) -> Effect:
    module_name, _, attribute = name.partition(":")
    if os.getcwd() not in sys.path:  # a module beside the data counts, as it does for `python -m`
        sys.path.append(os.getcwd())
    try:
        module = importlib.import_module(module_name)
    except Exception as error:
        raise MetadataError(**explained("effect_module", effect=name, problem=error)) from error
    effect = getattr(module, attribute or "EFFECT", None)
    if not isinstance(effect, Effect):
        names = [k for k, v in vars(module).items() if isinstance(v, Effect)]
        raise MetadataError(f"'{attribute}' in {module_name} is not an Effect", remedy=nearest(attribute, names))
    _try(effect, name)
    return effect


def _try(effect: Effect, name: str) -> None:
    """Send a short signal through an effect from outside, so that a mistake in it is told as such.

    As plain Python: a compiler's words would not help the author.
    Raises MetadataError when it fails, gives no numbers, is not the identity at its neutral values, or misdescribed."""
    signal, wrong = 0.5 - 0.2 * np.cos(np.arange(TRIAL) / 4.0), ""  # up and down
    try:
        Stage(effect.stage)
        started = {q.name: q.start[0] for q in effect.parameters if q.start}
        series = np.zeros(TRIAL if effect.column else effect.draws * (TRIAL + 1))
        for values in ({}, {} if any(q.many for q in effect.parameters) else started):
            p = effect.pack(values)
            state = effect.begin(p, 1.0, float(signal[0]), series)
            with np.errstate(all="ignore"):
                out = np.array([effect.step(state, value, p) for value in signal.tolist()], dtype=np.float64)
            if out.shape != signal.shape or not np.all(np.isfinite(out)):
                wrong = "gives no numbers on a trial signal"
            elif not values and not effect.draws and not np.allclose(out, signal, rtol=0.0, atol=1e-9):
                wrong = "changes the signal at its neutral values"
    except Exception as error:
        file, calls = sys.modules[name.partition(":")[0]].__file__, traceback.extract_tb(error.__traceback__)
        at = next((f" in line {call.lineno} of {file}" for call in reversed(calls) if call.filename == file), "")
        wrong = f"fails on a trial signal{at}: {type(error).__name__}: {error}"
    if wrong:
        raise MetadataError(**explained("own_effect", effect=name, wrong=wrong))
