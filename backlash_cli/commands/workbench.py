"""backlash compare and explain: the model's prediction beside the measurement, and which physical effect is missing."""

import sys
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import click

from .. import api
from ..effects.registry import load_effect
from ..errors import LoopError, UsageError, some
from ..loaders import Plant
from ..model import compare as compare_with
from ..model import explain as explain_record
from ..record import Note, Record
from ..reporter.explain_report import check_picture, judged, summary, to_csv, write_picture
from ..reporter.page import BACK, write_pages
from ..reporter.templates import sentence
from ..results import Comparison, Explanation, Model, PlantExplanation
from .options import Export, cluster
from .terminal import deliver, progress, put, refusal, say, say_failures

SUFFIXES = (".csv", ".json", ".html", ".htm", ".txt")
OF_ONE = ("loop", "add", "model_file", "save_model", "json_file", "html", "picture")
OF_ALL = ("output", "jobs", "engine", "scheduler", "loops_matching", "sample")


def compare(loop: str | None, model_file: Path | None, other_loop: bool, **given: Any) -> int:
    """Predict PV from the measured OP, compare it with the measured PV, and say where the model fails."""
    check_picture(given["picture"])
    return show(compare_with(*record_and_model(Export.of(given), loop, model_file, other_loop=other_loop)), given)


def explain(loop: str | None, add: tuple[str, ...], outside: tuple[str, ...], model_file: Path | None,
            other_loop: bool, save_model: Path | None, every: bool, **given: Any) -> int:
    """Find the physical effects that are missing in a loop's model, add them, and watch the error fall."""
    context = click.get_current_context()
    wrong = [p.opts[0] for p in context.command.params if p.name in (OF_ONE if every else OF_ALL)
             and context.params[p.name] not in (None, (), p.default)]
    if wrong:
        raise refusal(UsageError, "not_with_all" if every else "only_with_all", "--all" if every else wrong[0],
                      options=", ".join(wrong), option=wrong[0])
    export = Export.of(given)
    check_picture(given["picture"])
    more, chosen = ([load_effect(name) for name in names] for names in (outside, add))
    if every:
        return explain_plant(export, outside, given)
    record, model = record_and_model(export, loop, model_file, other_loop=other_loop)
    found = explain_record(record, model, add=chosen, effects=more)
    if save_model is not None and found.model is not None:
        api.save_model(found.model, save_model)
        say(f"model written to {save_model}")
    return show(found, given)


def show(found: Comparison | Explanation, given: Mapping[str, Any]) -> int:
    """Draw and write what was found where it was asked for, and show it."""
    if given["picture"] is not None:
        write_picture(found, given["picture"])
        say(f"picture written to {given['picture']}")
    return deliver(judged(found), given["json_file"], given["html"], verbose=given["verbose"])


def record_and_model(export: Export, name: str | None, model_file: Path | None, *, other_loop: bool
                     ) -> tuple[Record, Model | None]:
    """Read one loop and its model: the loop called `name`, else that of the model, else the only one there is.

    Raises UsageError listing the loops where it is open, and when the model belongs to another loop or other ranges."""
    model = None if model_file is None else api.load_model(model_file)
    if model is None or other_loop:
        return one_loop(export, name), model
    try:
        record = one_loop(export, name or model.loop)
    except UsageError as error:
        if name is not None or "no loop" not in error.what:
            raise
        raise refusal(UsageError, "model_loop_absent", model_file, loop=model.loop, hint=error.remedy) from error
    if model.loop.strip().lower() != record.loop.strip().lower():
        raise refusal(UsageError, "model_of_other_loop", model_file, loop=model.loop, other=record.loop)
    for key in ("pv_range", "op_range"):
        kept, now = getattr(model, key), getattr(record.settings, key)
        # a range guessed from the data gives way to the model's
        if kept is not None and tuple(kept) != tuple(now) and record.settings.source.get(key) != "data":
            raise refusal(UsageError, "model_range", model_file, key=key, kept=kept, now=now, loop=record.loop)
    return record, model


def one_loop(export: Export, name: str | None) -> Record:
    """Read the loop called `name`, else the only one there is. Raises UsageError listing the loops where it is open."""
    plant = export.read(only_loops=(name,) if name else ())
    if name is not None and name in {record.loop for record in plant}:
        return plant[name]
    if len(plant.records) == 1 and not (name is None and plant.failures):
        return plant.records[0]
    if not plant.records:
        raise LoopError(plant.failures[0].message if plant.failures else "no loop could be read")
    names, what = names_in(plant), "several loops here" if name is None else f"{name!r} means several loops"
    raise UsageError(f"{what}: {some(names, 20)}", where="--loop", remedy=f"choose one, for example --loop {names[0]}")


def names_in(plant: Plant) -> list[str]:
    """Return the names of all loops of a plant, of those that could not be read as well."""
    lost = (str(note.values["loop"]) for note in plant.failures if "loop" in note.values)
    return sorted({*(record.loop for record in plant), *lost})


def explain_plant(export: Export, effects: tuple[str, ...], given: Mapping[str, Any]) -> int:
    """Explain every loop and write the summary to a file or folder, or show it; 3 when a loop could not be."""
    from ..engines.local import answers
    output: Path | None = given["output"]
    folder = output is not None and output.suffix.lower() not in SUFFIXES
    if output is not None and output.exists() and output.is_dir() != folder:
        raise refusal(UsageError, "file_or_folder", f"--output {output}", there="file" if folder else "folder",
                      endings=", ".join(SUFFIXES[:3]))
    plant = export.read()
    names, found = names_in(plant), PlantExplanation((), plant.inputs, plant.warnings, plant.failures)

    def pages() -> Iterator[tuple[str, dict[str, str]]]:
        """Keep each explanation without its series; give page and numbers of its loop for a folder."""
        nonlocal found
        work = partial(explain_record, effects=effects)
        for result in answers(plant.records, work, jobs=given["jobs"], client=client):
            if isinstance(result, Note):
                found = replace(found, failures=(*found.failures, result))
            else:
                found = replace(found, loops=(*found.loops, result.light()))
                if folder:
                    report = judged(result)
                    yield result.loop, {"html": report.page(**BACK), "json": report.json()}
            step()

    with cluster(given) as client, progress("explaining", len(names),
                                            stopped="loops were explained; no summary was written") as step:
        if folder and output is not None:
            write_pages(output, (plant.inputs, export.reading), names, pages(),
                        lambda **where: summary(found).page(**where))
        else:
            list(pages())
    report = summary(found)
    if output is None:
        put(None, report.text(colour=sys.stdout.isatty()))
        return 3 if found.failures else 0
    if folder:
        put(output / "summary.csv", to_csv(found), "table")
        put(output / "summary.json", report.json(), "numbers")
    else:
        forms = {".csv": lambda: to_csv(found), ".json": report.json, ".txt": report.text}
        put(output, forms.get(output.suffix.lower(), report.page)(), "summary")
    say(sentence("summary", found, report.content["counts"]))
    return say_failures("not explained", [note.message for note in found.failures])
