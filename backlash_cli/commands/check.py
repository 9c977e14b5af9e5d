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
    from ..check import check as check_plant
    from ..reporter.check_table import checked

    plant = Export.of(given).read(compiles=False)
    with progress("checking", len(plant), stopped="loops were checked; no report was written") as step:
        result = check_plant(plant, step)
    form = form or ("json" if output is not None and output.suffix.lower() == ".json" else "table")
    report = checked(result)
    text = report.json() if form == "json" else report.text(
        verbose=verbose, colour=output is None and sys.stdout.isatty())
    put(output, text, f"{several(len(result.loops), 'loop')} checked, {form}")
    failed = [f"{loop.loop}: {loop.failure.message.removeprefix(f'{loop.loop}: ')}" for loop in result.loops
              if loop.failure is not None]
    return say_failures("not checked", failed + [note.message for note in result.failures],
                        shown=output is not None or form == "json")
