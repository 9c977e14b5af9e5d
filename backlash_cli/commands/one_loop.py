"""What compare and explain have in common: one loop out of an export, and the model that belongs to it."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from ..errors import BacklashError, LoopError, UsageError
from .terminal import put, say

if TYPE_CHECKING:
    from ..loaders import ReadOptions
    from ..record import Record
    from ..results import Comparison, Explanation, Model

Found = TypeVar("Found", "Comparison", "Explanation")


def one_loop(
    inputs: Sequence[Path], name: str | None, loops: Path | None, reading: ReadOptions, model_file: Path | None = None
) -> Record:
    """Read the loop called `name`, else that of the model, else the only one there is.

    Raises UsageError listing the loops where it is open, or when the loop of the model is not there.
    """
    from ..loaders import read

    if name is None and model_file is not None:
        from ..api import load_model

        name = load_model(model_file).loop
        try:
            return one_loop(inputs, name, loops, reading)
        except BacklashError as error:
            if "no loop" not in error.what:
                raise
            raise UsageError(f"this model is of loop {name}, which is not in this export", where=str(model_file),
                             remedy=f"{error.remedy}; --loop NAME --other-loop uses it for another loop") from error
    plant = read(list(inputs), loops=loops, options=replace(reading, only_loops=(name,) if name else ()))
    if name is not None and name in {record.loop for record in plant}:
        return plant[name]
    if len(plant.records) == 1 and not (name is None and plant.failures):
        return plant.records[0]
    names = sorted({*(record.loop for record in plant), *(str(n.values["loop"]) for n in plant.failures
                                                         if "loop" in n.values)})
    if not plant.records:
        raise LoopError(plant.failures[0].message if plant.failures else "no loop could be read")
    shown = ", ".join(names[:20]) + (f" and {len(names) - 20} more" if len(names) > 20 else "")
    what = "several loops here" if name is None else f"{name!r} means several loops"
    raise UsageError(f"{what}: {shown}", where="--loop", remedy=f"choose one, for example --loop {names[0]}")


def check_together(*, every: bool, plant: Mapping[str, object], single: Mapping[str, object]) -> None:
    """Refuse options that belong to one loop together with --all, and those of --all without it."""
    if every:
        wrong = [name for name, value in single.items() if value]
        if wrong:
            raise UsageError(f"{', '.join(wrong)} and --all do not fit together", where="--all",
                             remedy="--all explains every loop by search and writes --output")
    elif given := [name for name, value in plant.items() if value not in (None, ())]:
        name = given[0]
        remedy = "add --all; for one loop there are --json, --html and --save-model"
        raise UsageError(f"{name} goes with --all", where=name, remedy=remedy)


def check_places(inputs: Sequence[Path], *outputs: Path | None) -> None:
    """Refuse to write a result over the export it comes from."""
    for output in outputs:
        if output is not None and any(given.is_file() and output.resolve() == given.resolve() for given in inputs):
            raise UsageError("this is the export itself", where=str(output), remedy="choose another name")


def deliver(found: Found, page: Callable[[Found], str], text: Callable[..., str], *, picture: Path | None,
            html: Path | None, json_file: Path | None, verbose: bool) -> None:
    """Write what was asked for, and show the text unless the numbers go to standard output."""
    if picture is not None:
        from ..reporter.explain_report import write_picture

        write_picture(found, picture)
        say(f"picture written to {picture}")
    if html is not None:
        put(html, page(found), "page")
    if json_file is not None:
        from ..reporter.json_report import model_json

        put(json_file, model_json(found), "numbers")
    if str(json_file) != "-":
        put(Path("-"), text(found, verbose=verbose, colour=sys.stdout.isatty()))


def model_for(path: Path, record: Record, *, other_loop: bool) -> Model:
    """Read a model file and see that it belongs to this loop. Raises UsageError when it does not."""
    from ..api import load_model

    model = load_model(path)
    if other_loop:
        return model
    if model.loop.strip().lower() != record.loop.strip().lower():
        raise UsageError(f"this model is of loop {model.loop}, not of {record.loop}", where=str(path),
                         remedy=f"give --loop {model.loop}, or --other-loop to use it all the same")
    s = record.settings
    for key, kept, now in (("pv_range", model.pv_range, s.pv_range), ("op_range", model.op_range, s.op_range)):
        # a range guessed from the data gives way to the model's
        if kept is not None and tuple(kept) != tuple(now) and s.source.get(key) != "data":
            raise UsageError(
                f"the model's numbers belong to {key} = [{kept[0]:g}, {kept[1]:g}], this record is read with "
                f"[{now[0]:g}, {now[1]:g}]", where=str(path),
                remedy=f"set {key} of {record.loop} in its loops.toml as in the model, or fit the model anew; "
                       "--other-loop uses it all the same",
            )
    return model
