"""Scan results as one strict JSON document with the fields of the contract; no NaN, no Infinity."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime
from typing import Any

from .._version import __version__
from ..record import LoopSettings, Note
from ..results import Cluster, Compensator, Confirmation, Estimate, LoopReport, ScanResult
from .columns import estimates_json, shown

SCHEMA_VERSION = 1


def to_json(result: ScanResult) -> str:
    """Return the report of a whole run as JSON text: a line per loop, for people with `grep` and for speed."""
    return "".join(json_parts(result))


def json_parts(result: ScanResult) -> Iterator[str]:
    """The same text piece by piece, so that the report of a large plant need not be in memory as a whole."""
    before = "{"
    for name, value in _document(result, ()).items():
        yield f'{before}"{name}": '
        before = ",\n"
        if name == "loops" and result.loops:
            yield "[\n"
            for i, report in enumerate(result.loops):
                yield (",\n" if i else "") + _line(report)
            yield "\n]"
        elif isinstance(value, list) and value:
            yield "[\n" + ",\n".join(_dumped(v) for v in value) + "\n]"
        else:
            yield _dumped(value)
    yield "}\n"


def _line(report: LoopReport) -> str:
    text = _dumped(loop(report, ()))
    # within a string a quotation mark has a backslash before it, so this is found once only
    return text.replace('"estimates": []', f'"estimates": {estimates_json(report.estimates)}', 1)


_encoder = json.JSONEncoder(ensure_ascii=False, allow_nan=False)


def _dumped(value: Any) -> str:
    return _encoder.encode(strict(value))


def document(result: ScanResult) -> dict[str, Any]:
    """Return the report of a whole run as plain dicts and lists; times are ISO 8601 in UTC."""
    return _document(result, result.loops)


def _document(result: ScanResult, loops: Sequence[LoopReport]) -> dict[str, Any]:
    return {
        "schema_version": SCHEMA_VERSION,
        "tool": {"name": "backlash", "version": __version__},
        "inputs": list(result.inputs),
        "loops": [loop(report) for report in loops],
        "warnings": [_note(n) for n in result.warnings],
        "failures": [_note(n) for n in result.failures],
    }


def loop(report: LoopReport, listed: Sequence[Estimate] | None = None) -> dict[str, Any]:
    """Return one loop's report as plain values, names as in the contract. listed: half periods, if not all."""
    return {
        "loop": report.loop,
        "verdict": str(report.verdict),
        "reasons": [_note(n) for n in report.reasons],
        "confidence": report.confidence,
        "start": iso_time(report.start),
        "end": iso_time(report.end),
        "samples": report.samples,
        "interval_s": report.interval_s,
        "settings": _settings(report.settings),
        "half_periods": report.half_periods,
        "long_half_periods": report.long_half_periods,
        "detections": report.detections,
        "detection_rate": report.detection_rate,
        "detections_per_hour": report.detections_per_hour,
        "rejected": dict(report.rejected),
        "estimates": [
            {
                "start": iso_time(e.start),
                "end": iso_time(e.end),
                "dt_s": e.dt_s,
                "dy": e.dy,
                "e_max": e.e_max,
                "d": e.d,
                "direction": e.direction,
                "accepted": e.accepted,
                "why": e.why,
            }
            for e in (report.estimates if listed is None else listed)
        ],
        "cluster": _cluster(report.cluster),
        "confirmation": _confirmation(report.confirmation),
        "compensator": _compensator(report.compensator),
        "warnings": [_note(n) for n in report.warnings],
        "details": dict(report.details),
    }


def iso_time(epoch: float | None) -> str | None:
    """Return UTC epoch seconds as ISO 8601 text, with a fraction only where there is one; None if not a date."""
    if epoch is None or not math.isfinite(epoch):
        return None
    try:
        text = datetime.fromtimestamp(round(epoch, 3), UTC).isoformat(timespec="milliseconds")
    except (OverflowError, ValueError, OSError):
        return None
    return text.replace(".000", "").replace("+00:00", "Z")


def strict(value: Any) -> Any:
    """Return `value` as JSON can say it: NaN and infinity as null, arrays as lists, anything else as text."""
    if isinstance(value, float):
        return shown(value) if math.isfinite(value) else None
    if isinstance(value, str):
        return value if value.isascii() else value.encode("utf-8", "backslashreplace").decode()
    if value is None or isinstance(value, int):
        return value
    if isinstance(value, Mapping):
        return {k if type(k) is str and k.isascii() else strict(str(k)): strict(v) for k, v in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [strict(v) for v in value]
    return strict(value.tolist() if hasattr(value, "tolist") else str(value))


def _note(note: Note) -> dict[str, Any]:
    plain: dict[str, Any] = {"code": note.code, "message": note.message}
    return {**plain, "values": dict(note.values)} if note.values else plain


def _settings(s: LoopSettings) -> dict[str, Any]:
    return {
        "K": s.K,
        "Ti": s.Ti,
        "Td": s.Td,
        "Tf": s.filter_time,
        "Kp": s.Kp,
        "theta": s.theta,
        "pv_range": list(s.pv_range),
        "op_range": list(s.op_range),
        "source": dict(s.source),
    }


def _cluster(c: Cluster | None) -> dict[str, Any] | None:
    if c is None:
        return None
    return {
        "d": c.d,
        "ci95": list(c.ci95),
        "spread": c.spread,
        "n": c.n,
        "share": c.share,
        "limit_of_detection": c.limit_of_detection,
    }


def _confirmation(c: Confirmation | None) -> dict[str, Any] | None:
    if c is None:
        return None
    return {
        "d": c.d,
        "ci95": list(c.ci95),
        "error_reduction": c.error_reduction,
        "delta_bic": c.delta_bic,
        "limit_of_detection": c.limit_of_detection,
        "details": dict(c.details),
    }


def _compensator(c: Compensator | None) -> dict[str, Any] | None:
    return None if c is None else {"gain": c.gain, "scheme": c.scheme, "reason": c.reason}
