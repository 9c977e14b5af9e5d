"""A night's carry as bytes, small enough to keep for every loop and night."""

from __future__ import annotations

import json
import zlib
from collections.abc import Callable
from typing import Any

import numpy as np

from ..half_periods import OpenHalfPeriod
from ..record import FloatArray
from .carry import Carry, Tail


def pack(value: Carry | Tail) -> bytes:
    """Return `value` as bytes: JSON with the arrays after it, compressed; the same value gives the same bytes."""
    arrays: list[FloatArray] = []

    def plain(item: object) -> object:
        if isinstance(item, np.ndarray):
            arrays.append(np.ascontiguousarray(item, dtype="<f8"))
            return {"length": len(item)}
        if isinstance(item, (Tail, OpenHalfPeriod, Carry)):
            return {key: plain(getattr(item, key)) for key in item.__dataclass_fields__}
        if isinstance(item, tuple):
            return [plain(part) for part in item]
        return item

    text = json.dumps(plain(value), separators=(",", ":")).encode()
    return zlib.compress(len(text).to_bytes(4, "little") + text + b"".join(a.tobytes() for a in arrays), 6)


def unpack(data: bytes) -> Carry:
    """Return the Carry that `pack` made bytes of."""
    fields, arrays = _load(data)
    head = tuple(arrays(part) for part in fields["head"])
    return Carry(**{**fields, "head": head, "first": _open(fields["first"]), "edge": tuple(fields["edge"]),
                    "tail": _tail(fields["tail"], arrays)})


def unpack_tail(data: bytes) -> Tail:
    """Return the Tail that `pack` made bytes of."""
    fields, arrays = _load(data)
    tail = _tail(fields, arrays)
    assert tail is not None
    return tail


def _load(data: bytes) -> tuple[dict[str, Any], Callable[[dict[str, int]], FloatArray]]:
    raw = zlib.decompress(data)
    size = int.from_bytes(raw[:4], "little")
    values = np.frombuffer(raw[4 + size:], dtype="<f8").copy()
    position = 0

    def arrays(part: dict[str, int]) -> FloatArray:
        nonlocal position
        position += part["length"]
        return values[position - part["length"] : position]

    return json.loads(raw[4 : 4 + size]), arrays


def _open(fields: dict[str, object] | None) -> OpenHalfPeriod | None:
    return None if fields is None else OpenHalfPeriod(**fields)  # type: ignore[arg-type]


def _tail(fields: dict[str, Any] | None, arrays: Callable[[dict[str, int]], FloatArray]) -> Tail | None:
    if fields is None:
        return None
    return Tail(_open(fields["open"]), tuple(arrays(p) for p in fields["states"]), fields["last_index"])
