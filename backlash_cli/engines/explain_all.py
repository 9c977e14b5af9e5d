"""Explain every loop of a plant, in several processes or on a cluster; a loop that fails is named, the others go on."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING

from ..errors import BacklashError
from ..record import Note, Record
from ..results import Explanation
from .cluster import cores, on_cluster
from .local import in_processes

if TYPE_CHECKING:
    from distributed import Client


def explain_all(records: Sequence[Record], effects: Sequence[str] = (), *, jobs: int | None = None,
                client: Client | None = None) -> Iterator[Explanation | Note]:
    """Yield for every record, in order, its explanation, or a note that says why there is none.

    effects: references (`module:NAME`) of further effects to try. jobs: processes; None is one per core, 1 stays in
    this process. client: of a cluster that does the work. Closing the iterator stops the work.
    """
    work = partial(explain_loop, effects=tuple(effects))
    if client is not None:
        return on_cluster(client, records, work, _died)
    count = max(1, min(len(records), cores() if jobs is None else jobs))
    return (work(record) for record in records) if count == 1 else in_processes(records, work, _died, count)


def explain_loop(record: Record, effects: tuple[str, ...] = ()) -> Explanation | Note:
    """Return the explanation of one loop; whatever goes wrong becomes the note's message."""
    from ..model import explain

    try:
        return explain(record, effects=effects)
    except BacklashError as error:
        where = "" if error.where.startswith(record.loop) else f"{record.loop}: "
        return Note(error.code, f"{where}{error}", {"loop": record.loop})
    except Exception as error:  # one loop's failure must not cost the others their answer
        return unexplained(record.loop, Note("internal_error", f"failed: {type(error).__name__}: {error}"))


def unexplained(loop: str, reason: Note) -> Note:
    """The note of a loop that has no explanation."""
    return Note(reason.code, f"{loop}: {reason.message}", {**reason.values, "loop": loop})


def _died(record: Record, reason: Note) -> Note:
    return unexplained(record.loop, reason)
