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
from .local import answers


def plan_all(records: Sequence[Record], options: PlanOptions, *, jobs: int | None = None,
             cache: Path | None = None) -> Iterator[LoopPlan | Note | None]:
    """Yield for every record, in order, its plan, None where the scan has decided it, or a note why there is none.

    jobs: processes; None is one per core. cache: folder of plans made before, None for none.
    """
    return answers(records, partial(_planned, options=options, cache=cache), jobs=jobs)


def _planned(record: Record, options: PlanOptions, cache: Path | None) -> LoopPlan | None:
    """The plan of one loop, from the folder where it is kept there."""
    kept = None if cache is None else cache / f"{key_of(record, options)}.json"
    if kept is not None:
        with contextlib.suppress(OSError, msgspec.DecodeError):  # none there, or from another version
            return msgspec.json.decode(kept.read_bytes(), type=LoopPlan | None)
    found = plan(record, options)
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
