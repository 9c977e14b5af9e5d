"""Results as plain values, and as strict JSON with the fields of the contract; no NaN, no Infinity."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from .._version import __version__
from ..record import FloatArray, Note
from ..results import Estimate, LoopReport, ScanResult
from ..results.scan import Estimates

SCHEMA_VERSION = 1
NO_DATE = 2.5e11  # seconds from 1970 beyond which a time is no date (year 9892)
_NUMBERS = ("dt_s", "dy", "e_max", "d")


def to_json(result: ScanResult) -> str:
    """Return the report of a whole run as JSON text: a line per loop, for people with `grep` and for speed."""
    return "".join(json_parts(result))


def json_parts(result: ScanResult) -> Iterator[str]:
    """The same text piece by piece, so that the report of a large plant need not be in memory as a whole."""
    before = "{"
    parts = {"inputs": result.inputs, "loops": result.loops, "warnings": result.warnings, "failures": result.failures}
    for name, value in {**header(), **parts}.items():
        yield f'{before}"{name}": '
        before = ",\n"
        if name in parts and value:
            for i, one in enumerate(value):
                yield ("[\n", ",\n")[i > 0] + _line(loop(one) if name == "loops" else strict(one))
            yield "\n]"
        else:
            yield _line(strict(value))
    yield "}\n"


def loop(report: LoopReport) -> dict[str, Any]:
    """Return one loop's report as plain values, names as in the contract; times are ISO 8601 in UTC."""
    s, confirmed = report.settings, report.confirmation
    found: dict[str, Any] = strict({
        **fields_of(report, "carry"), "start": iso_time(report.start), "end": iso_time(report.end), "estimates": (),
        "settings": {**fields_of(s), "Tf": s.filter_time},
        "confirmation": None if confirmed is None else fields_of(confirmed, "profile"),
    })
    halves = half_periods(report.estimates)
    found["estimates"] = [dict(zip(halves, row, strict=True)) for row in zip(*halves.values(), strict=True)]
    return found


def half_periods(found: Sequence[Estimate]) -> dict[str, list[Any]]:
    """Half periods column by column, as strict values: a plant has hundreds of thousands of them."""
    e = found if isinstance(found, Estimates) else _as_columns(found)
    why = [e.codes[code] for code in e.why.tolist()]
    numbers = {name: [shown(v) for v in getattr(e, name).tolist()] for name in _NUMBERS}
    return {"start": times(e.origin + e.begin), "end": times(e.origin + (e.begin + e.dt_s)), **numbers,
            "direction": e.direction.tolist(), "accepted": [code == "ok" for code in why], "why": why}


def _as_columns(found: Sequence[Estimate]) -> Estimates:
    codes = tuple(sorted({e.why for e in found}))
    start, dt_s, dy, e_max, d = (np.array([getattr(e, name) for e in found], dtype=np.float64)
                                 for name in ("start", *_NUMBERS))
    return Estimates(0.0, start, dt_s, dy, e_max, d, np.array([e.direction for e in found], dtype=np.int8),
                     np.array([codes.index(e.why) for e in found], dtype=np.uint8), codes)


def header() -> dict[str, Any]:
    """How every document begins."""
    return {"schema_version": SCHEMA_VERSION, "tool": {"name": "backlash", "version": __version__}}


def json_text(document: Mapping[str, Any]) -> str:
    """Return a document as strict JSON text, ending with a line end."""
    return json.dumps(strict(document), ensure_ascii=False, allow_nan=False, indent=1) + "\n"


def strict(value: Any) -> Any:
    """Return `value` as JSON can say it: NaN and infinity as null, arrays as lists, results by the names of their
    fields (numbers of a Note only where there are any), anything else as text."""
    if isinstance(value, float):
        return shown(value)
    if isinstance(value, str):
        return str(value) if value.isascii() else value.encode("utf-8", "backslashreplace").decode()
    if value is None or isinstance(value, int):
        return value
    if isinstance(value, Mapping):
        return {k if type(k) is str and k.isascii() else strict(str(k)): strict(v) for k, v in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [strict(v) for v in value]
    if isinstance(value, Note) and not value.values:
        return {"code": strict(value.code), "message": strict(value.message)}
    if is_dataclass(value):
        return strict(fields_of(value))
    return strict(value.tolist() if hasattr(value, "tolist") else str(value))


def fields_of(value: Any, *without: str) -> dict[str, Any]:
    """Return the fields of a result by name, but for those named."""
    return {f.name: getattr(value, f.name) for f in fields(value) if f.name not in without}


def shown(value: float) -> float | None:
    """A number to the ten digits that reports show; None for what is none."""
    rounded = float(f"{value:.10g}")
    return rounded if math.isfinite(rounded) else None


def iso_time(epoch: float | None) -> str | None:
    """Return UTC epoch seconds as ISO 8601 text, with a fraction only where there is one; None if not a date."""
    return None if epoch is None else times(np.array([epoch], dtype=np.float64))[0]


def times(epoch: FloatArray) -> list[str | None]:
    """The same for many.

    >>> times(np.array([0.0, 1.5, np.nan]))
    ['1970-01-01T00:00:00Z', '1970-01-01T00:00:01.500Z', None]
    """
    known = np.abs(epoch) < NO_DATE
    milliseconds = np.rint(1000.0 * np.where(known, epoch, 0.0)).astype("datetime64[ms]")
    stamps = np.datetime_as_string(milliseconds, unit="ms").tolist()
    return [stamp.replace(".000", "") + "Z" if there else None
            for stamp, there in zip(stamps, known.tolist(), strict=True)]


_line = json.JSONEncoder(ensure_ascii=False, allow_nan=False).encode
