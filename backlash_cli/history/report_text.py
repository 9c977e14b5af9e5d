"""A loop's report as one line of JSON and back exactly: numbers with all their digits, tuples and arrays as such."""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from ..record import LoopSettings, Note
from ..results import Cluster, Compensator, Confirmation, Estimate, Estimates, LoopReport, Verdict

_KNOWN: dict[str, Any] = {
    kind.__name__: kind
    for kind in (LoopReport, LoopSettings, Note, Estimate, Estimates, Cluster, Confirmation, Compensator)
}
_KIND = "~"  # the key that says what a JSON object stands for; a mapping that has it itself is written as pairs


def to_text(value: object) -> str:
    """Return a report, or a tuple or mapping of such, as JSON on one line.

    Raises TypeError for what cannot be brought back as it was.
    """
    return json.dumps(_plain(value), separators=(",", ":"))


def from_text(text: str | bytes) -> Any:
    """Return what `to_text` was given. Raises ValueError, KeyError or TypeError for any other text."""
    return _value(json.loads(text))


def _plain(value: Any) -> Any:
    if isinstance(value, Verdict):
        return {_KIND: "Verdict", "is": str(value)}
    if value is None or isinstance(value, str | bool | int | float):
        return value
    if is_dataclass(value):
        name = type(value).__name__
        if _KNOWN.get(name) is not type(value):
            raise TypeError(f"{name} cannot be kept")
        return {_KIND: name, **{f.name: _plain(getattr(value, f.name)) for f in fields(value)}}
    if isinstance(value, tuple):
        return {_KIND: "tuple", "of": list(map(_plain, value))}
    if isinstance(value, list):
        return list(map(_plain, value))
    if isinstance(value, bytes):
        return {_KIND: "bytes", "is": base64.b64encode(value).decode()}
    if isinstance(value, np.ndarray) and value.ndim == 1 and value.dtype.kind in "fiub":
        return {_KIND: "array", "of": value.dtype.str, "is": base64.b64encode(value.tobytes()).decode()}
    if isinstance(value, Mapping) and all(isinstance(key, str) for key in value):
        if _KIND in value:
            return {_KIND: "mapping", "of": [[key, _plain(item)] for key, item in value.items()]}
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, np.generic):
        return _plain(value.item())
    raise TypeError(f"{type(value).__name__} cannot be kept")


def _value(plain: Any) -> Any:
    if isinstance(plain, list):
        return list(map(_value, plain))
    if not isinstance(plain, dict):
        return plain
    kind = plain.pop(_KIND, None)
    if kind is None:
        return {key: _value(item) for key, item in plain.items()}
    if kind == "tuple":
        return tuple(map(_value, plain["of"]))
    if kind == "bytes":
        return base64.b64decode(plain["is"])
    if kind == "array":
        return np.frombuffer(base64.b64decode(plain["is"]), plain["of"])
    if kind == "mapping":
        return {key: _value(item) for key, item in plain["of"]}
    if kind == "Verdict":
        return Verdict(plain["is"])
    return _KNOWN[kind](**{name: _value(item) for name, item in plain.items()})
