"""Finds the tests of a valve in a record: stretches in manual in which a hand moved OP there and back."""

import numpy as np

from ..record import AT_LIMIT, Record, SampleState
from .confirm import HOLE
from .predictor import Recording, recording_of
from .width_profile import NARROWEST

LEAD = 2000  # samples before a test, at most as many as in it: where the stem stood, and what PV still answers to
MOST_TESTS = 12  # the last ones


def manual_stretches(record: Record) -> list[Recording]:
    """Return the stretches in manual in which OP went there and back, in % of span, the last MOST_TESTS of them.

    Each with what lies before it; there it is not `usable`."""
    index, state, output = record.index, record.state, record.output
    if output is None or not (state == SampleState.MANUAL).any():
        return []
    from ..kernels import gap_crossings

    by_hand = (state == SampleState.MANUAL) & (output > AT_LIMIT) & (output < 1.0 - AT_LIMIT)
    lost = (state == SampleState.MISSING) | (state == SampleState.IMPLAUSIBLE)
    rows = np.flatnonzero(by_hand)
    others = np.cumsum(~by_hand & ~lost)
    apart = np.flatnonzero((np.diff(others[rows]) > 0) | (np.diff(index[rows]) > HOLE)) + 1
    holes = np.append(0, np.flatnonzero(np.diff(index) > HOLE) + 1)
    found = []
    for part in np.split(rows, apart):
        if not len(part) or not gap_crossings(100.0 * output[part], NARROWEST):
            continue
        lead = min(part[-1] + 1 - part[0], LEAD)
        first = max(part[0] - lead, holes[np.searchsorted(holes, part[0], side="right") - 1])
        cut = slice(first, part[-1] + 1)
        usable = by_hand[cut] & np.isfinite(record.measurement[cut])
        usable[: part[0] - first] = False
        if not usable.any():
            continue
        found.append(recording_of(index[cut], output[cut], record.measurement[cut], usable, scale=100.0))
    return found[-MOST_TESTS:]
