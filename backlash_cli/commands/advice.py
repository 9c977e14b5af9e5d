"""backlash plan and compensate: advice to a person, found by simulating the loop of a record."""

import contextlib
import os
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from .._version import __version__
from ..engines.local import answers
from ..errors import BacklashError, LoopError
from ..plan import Move, PlanOptions
from ..plan import plan as plan_of
from ..record import Note, Record, fingerprint
from ..reporter import advice
from ..reporter.files import form_of, make_folder, write_text
from ..reporter.safe import counted
from ..results.advice import LoopPlan
from ..simulator.compensation import compensate as study_of
from ..simulator.scenario_file import parse_process
from . import options
from .options import Export, cluster
from .terminal import deliver, progress, put, say_failures

PLANS = {".txt": "text", ".json": "json", ".csv": "csv", ".html": "html", ".htm": "html"}
MOVE = "a number in units of the loop such as 12.5, or a share of its span such as 5%"


def plan(target: str | None, max_pv_move: str, max_op_move: str, form: str | None, output: Path | None, repeats: int,
         seed: int, jobs: int | None, no_cache: bool, **given: Any) -> int:
    """Work out the least that would decide each loop that a scan leaves undecided, by simulating it."""
    pv_move, op_move = (Move(*options.size(text, where, "move", MOVE, 1.0 if text[-1:] == "%" else 1e300))
                        for text, where in ((max_pv_move, "--max-pv-move"), (max_op_move, "--max-op-move")))
    wanted = PlanOptions(options.dead_band(target, "--target"), pv_move, op_move, repeats, seed)
    form, plant = form or form_of(output, PLANS), Export.of(given).read()
    plans: list[LoopPlan] = []
    failures = [note.message for note in plant.failures]
    cache = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")  # as it is written: no home
    folder = None if no_cache or cache.startswith("~") else Path(cache, "backlash", "plans")
    with progress("planning", len(plant), stopped="loops were planned; no plan was written") as step:
        work = partial(kept_plan, options=wanted, folder=folder)
        for found in answers(plant.records, work, jobs=jobs):
            if isinstance(found, Note):
                failures.append(found.message)
            elif found is not None:
                plans.append(found)
            step()
    report = advice.plans(plans, len(plant), plant.inputs)
    made = {"html": report.page, "text": report.text, "json": report.json, "csv": lambda: advice.plans_csv(plans)}
    put(output, made[form](), counted(len(plans), "plan"))
    return say_failures("not planned", failures)


def kept_plan(record: Record, options: PlanOptions, folder: Path | None) -> LoopPlan | None:
    """Return the plan of one loop, from the folder where it is kept there; None where the scan has decided the loop."""
    if folder is None:
        return plan_of(record, options)
    said = (__version__, record.loop, record.start, record.interval, record.settings, options)
    signals = (record.index, record.setpoint, record.measurement, record.output, record.state)
    samples = b"".join(np.ascontiguousarray(values).data for values in signals if values is not None)
    kept = folder / f"{fingerprint(repr(said), more=samples)}.json"
    with contextlib.suppress(OSError, msgspec.DecodeError):  # none there, or from another version
        return msgspec.json.decode(kept.read_bytes(), type=LoopPlan | None)
    found = plan_of(record, options)
    with contextlib.suppress(OSError, BacklashError):  # a plan that cannot be kept is made again next time
        make_folder(folder)
        write_text(kept, msgspec.json.encode(found).decode())
    return found


def compensate(loop: str, process_text: str | None, dead_band: str | None, html: Path | None, json_file: Path | None,
               **given: Any) -> int:
    """Simulate one loop without and with backlash compensation, and advise a gain or say why none."""
    work = partial(study_of, process=parse_process(process_text) if process_text else None,
                   dead_band=options.dead_band(dead_band))
    with cluster(given) as client:
        record = Export.of(given).read()[loop]
        study = work(record) if client is None else next(answers([record], work, client=client))
    if isinstance(study, Note):
        raise LoopError(study.message, code=study.code)
    return deliver(advice.compensation(study), json_file, html)
