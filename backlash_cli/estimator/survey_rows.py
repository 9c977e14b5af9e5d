"""What a survey has kept of one picture, put together again; compiled by numba (see survey_walk)."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from ..record import FloatArray, IntArray
from .survey_walk import NOWHERE, ROWS, STATES


@numba.njit(cache=True, nogil=True)
def gather(held: IntArray, most: int, kept: FloatArray, kinds: NDArray[np.uint8],
           only: int) -> tuple[IntArray, FloatArray]:
    """Grid numbers (rows,) and signals (3, rows) of what is kept of one picture, in time order.

    held: the stretch in each slot, NOWHERE in empty ones; every second is taken where there are more than `most`. only:
    highest state wanted, of single samples; STATES for means.
    """
    order, n = np.empty(len(held), np.int64), 0
    for slot in range(len(held)):
        if held[slot] != NOWHERE:
            place = n
            while place > 0 and held[order[place - 1]] > held[slot]:
                order[place] = order[place - 1]
                place -= 1
            order[place] = slot
            n += 1
    slots = order[: n : 2 if n > most else 1]
    stretches = held[slots]
    counts, total = np.zeros(len(slots), np.int64), 0
    for k in range(len(slots)):
        setpoint, kind = kept[0, slots[k]], kinds[slots[k]]
        n = 0
        for i in range(ROWS):
            n += (setpoint[i] == setpoint[i]) & ((only == STATES) | (kind[i] <= only))
        counts[k] = n
        total += n
    index, rows = np.empty(total, np.int64), np.empty((3, total))
    to = 0
    for k in range(len(slots)):
        slot, first = slots[k], stretches[k] * ROWS
        if counts[k] == ROWS:
            for i in range(ROWS):
                index[to + i] = first + i
            for signal in range(3):
                row, values = rows[signal], kept[signal, slot]
                for i in range(ROWS):
                    row[to + i] = values[i]
            to += ROWS
            continue
        for i in range(ROWS):
            if np.isnan(kept[0, slot, i]) or (only != STATES and kinds[slot, i] > only):
                continue
            index[to], rows[0, to], rows[1, to] = first + i, kept[0, slot, i], kept[1, slot, i]
            rows[2, to] = kept[2, slot, i]
            to += 1
    return index, rows
