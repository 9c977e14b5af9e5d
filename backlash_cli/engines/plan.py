"""Plans that were made before are read from a folder."""

import contextlib
import hashlib
from pathlib import Path

import msgspec
import numpy as np

from .._version import __version__
from ..errors import BacklashError
from ..plan import PlanOptions, plan
from ..record import Record
from ..reporter.files import make_folder, write_text
from ..results.advice import LoopPlan


def kept_plan(record: Record, options: PlanOptions, folder: Path | None) -> LoopPlan | None:
    """Return the plan of one loop, from the folder where it is kept there; None where the scan has decided the loop."""
    if folder is None:
        return plan(record, options)
    said = (__version__, record.loop, record.start, record.interval, record.settings, options)
    name = hashlib.sha256(repr(said).encode("utf-8", "backslashreplace"))
    for values in (record.index, record.setpoint, record.measurement, record.output, record.state):
        name.update(b"" if values is None else np.ascontiguousarray(values).data)
    kept = folder / f"{name.hexdigest()[:32]}.json"
    with contextlib.suppress(OSError, msgspec.DecodeError):  # none there, or from another version
        return msgspec.json.decode(kept.read_bytes(), type=LoopPlan | None)
    found = plan(record, options)
    with contextlib.suppress(OSError, BacklashError):  # a plan that cannot be kept is made again next time
        make_folder(folder)
        write_text(kept, msgspec.json.encode(found).decode())
    return found
