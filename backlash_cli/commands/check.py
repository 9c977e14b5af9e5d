"""backlash check: is the data good enough, and do the controller settings agree with it?"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from .options import Export, command
from .terminal import progress, put, say_failures, several


@command
def check(form: str | None, output: Path | None, verbose: bool, **given: Any) -> int:
    """Check data quality and controller settings before trusting a verdict."""
    from ..check import LoopCheck, check_loop
    from ..engines.local import answers
    from ..reporter.check_table import checked
    from ..results import PlantResult

    plant = Export.of(given).read(compiles=False)
    loops = []
    with progress("checking", len(plant), stopped="loops were checked; no report was written") as step:
        for record, found in zip(plant, answers(plant.records, check_loop, jobs=1), strict=True):
            loops.append(found if isinstance(found, LoopCheck) else
                         LoopCheck(record.loop, notes=record.notes, failure=found))
            step()
    unread = {str(note.values["loop"]): note for note in plant.failures if note.values.get("loop")}
    known = {loop.loop for loop in loops}
    loops += [LoopCheck(name, failure=note) for name, note in unread.items() if name not in known]
    rest = tuple(note for note in plant.failures if not note.values.get("loop"))
    result = PlantResult(tuple(loops), plant.inputs, plant.warnings, rest)
    form = form or ("json" if output is not None and output.suffix.lower() == ".json" else "table")
    report, coloured = checked(result), output is None and sys.stdout.isatty()
    put(output, report.json() if form == "json" else report.text(verbose=verbose, colour=coloured),
        f"{several(len(loops), 'loop')} checked, {form}")
    failed = [f"{loop.loop}: {loop.failure.message.removeprefix(f'{loop.loop}: ')}" for loop in loops if loop.failure]
    return say_failures("not checked", failed + [note.message for note in result.failures],
                        shown=output is not None or form == "json")
