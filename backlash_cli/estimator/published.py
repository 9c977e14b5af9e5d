"""The paper's estimator alone: filters, half periods, gates and (15), without our own verdict on top."""

from __future__ import annotations

from ..record import Record
from ..results import Estimate
from .haegglund import error_scanner, estimate
from .rule import INCOMPLETE, TOO_SHORT


def published_estimates(record: Record) -> tuple[Estimate, ...]:
    """Return every half period of at least 5 Ti of a record, as the publication treats it; `accepted` are detections.

    The record's settings must hold K and Ti. Times are UTC epoch seconds. Source: Haegglund (2007), section 4.
    """
    scanner = error_scanner(record.settings, record.interval)
    scanner.update(record)
    h = estimate(scanner.smooth.finish(), record.interval, record.settings)
    why = h.why.tolist()
    return tuple(
        Estimate(record.start + float(h.begin[i]), record.start + float(h.begin[i] + h.duration[i]),
                 float(h.duration[i]), float(h.dy[i]), float(h.e_max[i]), float(h.d[i]), int(h.direction[i]),
                 why[i] == "ok", why[i])
        for i in range(len(h)) if h.refused[i] not in (TOO_SHORT, INCOMPLETE)
    )
