"""Plan every undecided loop of a plant, in several processes; plans that were made before are read from a folder."""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

import msgspec
import numpy as np

from .._version import __version__
from ..errors import BacklashError
from ..plan import PlanOptions, plan
from ..record import Note, Record
from ..reporter.files import make_folder, write_text
from ..results.plan import LoopPlan
from .explain_all import unexplained
from .local import cores, in_processes


def plan_all(records: Sequence[Record], options: PlanOptions, *, jobs: int | None = None,
             cache: Path | None = None) -> Iterator[LoopPlan | Note | None]:
    """Yield for every record, in order, its plan, None where the scan has decided it, or a note why there is none.

    jobs: processes; None is one per core. cache: folder of plans made before, None for none.
    """
    work = partial(plan_loop, options=options, cache=cache)
    count = max(1, min(len(records), cores() if jobs is None else jobs))
    if count == 1:
        return (work(record) for record in records)
    return in_processes(records, work, _died, count)


def plan_loop(record: Record, options: PlanOptions, cache: Path | None = None) -> LoopPlan | Note | None:
    """Return the plan of one loop; whatever goes wrong becomes the note's message."""
    kept = None if cache is None else cache / f"{key_of(record, options)}.json"
    if kept is not None:
        with contextlib.suppress(OSError, msgspec.DecodeError):  # none there, or from another version
            return msgspec.json.decode(kept.read_bytes(), type=LoopPlan | None)
    try:
        found = plan(record, options)
    except BacklashError as error:
        return unexplained(record.loop, Note(error.code, str(error)))
    except Exception as error:  # one loop's failure must not cost the others their answer
        return unexplained(record.loop, Note("internal_error", f"failed: {type(error).__name__}: {error}"))
    if kept is not None:
        with contextlib.suppress(OSError, BacklashError):  # a plan that cannot be kept is made again next time
            make_folder(kept.parent)
            write_text(kept, msgspec.json.encode(found).decode())
    return found


def key_of(record: Record, options: PlanOptions) -> str:
    """Return what names a plan: a fingerprint of the record, its settings, the options and the program's version."""
    said = (__version__, record.loop, record.start, record.interval, record.settings, options)
    total = hashlib.sha256(repr(said).encode("utf-8", "backslashreplace"))
    for values in (record.index, record.setpoint, record.measurement, record.output, record.state):
        total.update(b"" if values is None else np.ascontiguousarray(values).data)
    return total.hexdigest()[:32]


def _died(record: Record, reason: Note) -> Note:
    return unexplained(record.loop, reason)
