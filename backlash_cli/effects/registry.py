"""Finds an effect by name: the project's own, installed ones (entry points), or `module:NAME` from a user's file."""

from __future__ import annotations

import importlib
import os
import sys
from functools import lru_cache

from ..errors import MetadataError, nearest
from . import EFFECTS
from .shape import Effect

GROUP = "backlash.effects"


def load_effect(name: str) -> Effect:
    """Return the effect called `name`, or the one that `module:NAME` points to.

    Raises MetadataError when there is none, or when what is found has not the shape of an effect.
    """
    if ":" in name:
        return _from_module(name)
    known = {effect.name: effect for effect in all_effects()}
    if name not in known:
        raise MetadataError(f"no effect '{name}'", remedy=nearest(name, known) + " (list: backlash effects)")
    return known[name]


@lru_cache(maxsize=1)
def all_effects() -> tuple[Effect, ...]:
    """Return the project's effects in the order a signal meets them, then those of installed packages."""
    from importlib.metadata import entry_points

    found = [_from_module(point.value) for point in sorted(entry_points(group=GROUP), key=lambda e: e.name)]
    return (*EFFECTS, *found)


def _from_module(name: str) -> Effect:
    module_name, _, attribute = name.partition(":")
    # a module beside the data counts, as it does for `python -m`
    if os.getcwd() not in sys.path:
        sys.path.append(os.getcwd())
    try:
        module = importlib.import_module(module_name)
    except Exception as error:
        raise MetadataError(
            f"cannot load effect '{name}': {error}", remedy="check the module's name and that it can be imported here"
        ) from error
    effect = getattr(module, attribute or "EFFECT", None)
    if not isinstance(effect, Effect):
        names = [k for k, v in vars(module).items() if isinstance(v, Effect)]
        raise MetadataError(f"'{attribute}' in {module_name} is not an Effect", remedy=nearest(attribute, names))
    return effect
