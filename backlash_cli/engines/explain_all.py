"""Explain every loop of a plant, in several processes or on a cluster; a loop that fails is named, the others go on."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING

from ..record import Note, Record
from ..results import Explanation
from .local import answers

if TYPE_CHECKING:
    from distributed import Client


def explain_all(records: Sequence[Record], effects: Sequence[str] = (), *, jobs: int | None = None,
                client: Client | None = None) -> Iterator[Explanation | Note]:
    """Yield for every record, in order, its explanation, or a note that says why there is none.

    effects: references (`module:NAME`) of further effects to try. jobs: processes; None is one per core, 1 stays in
    this process. client: of a cluster that does the work. Closing the iterator stops the work.
    """
    return answers(records, partial(_explained, effects=tuple(effects)), jobs=jobs, client=client)


def _explained(record: Record, effects: tuple[str, ...]) -> Explanation:
    from ..model import explain

    return explain(record, effects=effects)
