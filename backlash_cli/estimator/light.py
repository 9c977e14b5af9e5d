"""A light look first: where the rows with the most motion of OP exclude every dead band, the others need no weighing.

Of simulated days two in three healthy ones end here, and none of 250 worn ones whose dead band the full test finds.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .decimate import STRETCH
from .evidence import Evidence, Rows, counted, excluding, weigh

LIGHT_ROWS = 500  # a quarter of a long record's: with a dead band of evidence 8 in all of them, 2 are left
LONG = 3 * LIGHT_ROWS  # rows; for shorter records the light look costs more than it saves
EXCLUDED = 6.0  # nats by which every width must lie behind: the same that the limit of detection asks for
STEP_ROWS = 40  # rows (ten Ti) per load step; where it steps more often, single steps are a poor model of the load


def weigh_lightly(rows: Rows) -> Evidence:
    """Return the evidence of a part of the rows where it excludes every width, of all of them where it does not."""
    if len(rows.y) < LONG:
        return weigh(rows)
    part = liveliest(rows, LIGHT_ROWS)
    found = excluding(part, EXCLUDED) if 2 * counted(part.first).sum() > len(part.y) else None
    return found if found is not None and found.steps * STEP_ROWS <= found.rows else weigh(rows)


def liveliest(rows: Rows, most: int) -> Rows:
    """Return whole stretches of `rows`, those in which OP travels most, until there are `most` rows."""
    at = np.arange(len(rows.y)) if rows.at is None else rows.at
    number = (at // STRETCH) - at[0] // STRETCH
    travel = np.bincount(number, np.abs(np.diff(rows.x[0], prepend=rows.x[0, 0])) * ~rows.first)
    size = np.bincount(number)
    order = np.argsort(-travel, kind="stable")
    taken = order[: 1 + int(np.searchsorted(np.cumsum(size[order]), most))]
    use = np.flatnonzero(np.isin(number, taken))
    first = rows.first[use] | (np.diff(at[use], prepend=at[use[0]] - 2) != 1)
    start = np.maximum.accumulate(np.where(first, np.arange(len(use)), 0))
    y, x = rows.y[use], np.take(rows.x, use, axis=1)
    stem = None if rows.stem is None else rows.stem[:, use]
    return replace(rows, y=y - y[start], x=x - x[:, start], first=first, line=rows.line[:, use], at=at[use], stem=stem)
