"""backlash compare and explain: the model's prediction beside the measurement, and which physical effect is missing."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ..errors import LoopError, UsageError
from . import options
from .options import Export, Workers
from .terminal import deliver, progress, put, say, say_failures

if TYPE_CHECKING:
    from ..loaders import Plant
    from ..record import Note, Record
    from ..results import Explanation, Model, PlantExplanation

SUFFIXES = (".csv", ".json", ".html", ".htm", ".txt")
loop_option = click.option("--loop", metavar="NAME",
                           help="The loop to look at. Default: the model's, or the only one there is.")
other_loop_option = click.option("--other-loop", is_flag=True,
                                 help="Use a model that was made for another loop or other ranges.")
picture_option = options.path("--picture", help="Draw one still picture, .png or .svg, for a document or mail.")


@click.command(short_help="Compare a model with the measurements of a loop.",
               epilog="\b\nExamples:\n  backlash compare sample_data/plant.csv --loop FIC109\n"
               "  backlash compare sample_data/plant.csv --loop FIC109 --html compare.html\n"
               "  backlash explain sample_data/plant.csv --loop FIC109 --save-model fic109.toml\n"
               "  backlash compare sample_data/plant.csv --model fic109.toml")
@loop_option
@options.path("--model", "model_file", help="Model file (TOML) as explain --save-model writes it. Default: the plain "
             "model (gain, one lag, offset; dead time where the settings give theta), fitted to this record.")
@other_loop_option
@options.JSON
@options.path("--html", help="Draw measured and predicted PV, the residual and what it depends on.")
@picture_option
@options.verbose("List every region of the record.")
@options.export()
def compare(loop: str | None, model_file: Path | None, other_loop: bool, json_file: Path | None, html: Path | None,
            picture: Path | None, verbose: bool, **given: Any) -> int:
    """Predict PV from the measured OP, compare it with the measured PV, and say where the model fails.

    INPUT is one or more CSV or Parquet files, or folders of them; they must hold the controller output (OP). The
    error is given for the fit, for samples the fit did not see, and beside the measurement noise.
    """
    from ..model import compare as compare_with
    from ..reporter.explain_report import judged, write_picture

    export = Export.of(given)
    check_places(export, picture, json_file, html)
    found = compare_with(*record_and_model(export, loop, model_file, other_loop=other_loop))
    if picture is not None:
        write_picture(found, picture)
        say(f"picture written to {picture}")
    return deliver(judged(found), json_file, html, verbose=verbose)


@click.command(short_help="Find the physical effects that are missing in a loop's model.",
               epilog="\b\nExamples:\n  backlash explain sample_data/plant.csv --loop FIC109\n"
               "  backlash explain sample_data/plant.csv --loop FIC109 --html explain.html --save-model fic109.toml\n"
               "  backlash explain sample_data/plant.csv --all --output effects.csv")
@loop_option
@click.option("--add", metavar="EFFECT", multiple=True,
              help="Your own choice instead of the search: add this effect (backlash effects lists them); may be "
              "repeated. module:NAME is one from outside.")
@click.option("--effect", "outside", metavar="MODULE:NAME", multiple=True,
              help="Also try this effect of your own in the search; may be repeated.")
@options.path("--model", "model_file",
             help="Go on from this model file (TOML): its effects stay, their numbers are refitted.")
@other_loop_option
@options.path("--save-model",
             help="Keep the final model as TOML, to edit by hand, go on with, or compare with another day.")
@options.JSON
@options.path("--html", help="Draw the ladder, each step over the measurement.")
@click.option("--all", "every", is_flag=True, help="Explain every loop of the plant and write a summary.")
@options.output("With --all: the summary as .csv, .json or .html, or a folder with all three and the JSON of each "
                "loop. Default: a table on the terminal.", "FILE|DIR")
@picture_option
@options.verbose("List every candidate with its numbers, and every region.")
@options.JOBS
@options.ENGINE
@options.export(*options.SELECTION)
def explain(loop: str | None, add: tuple[str, ...], outside: tuple[str, ...], model_file: Path | None,
            other_loop: bool, save_model: Path | None, json_file: Path | None, html: Path | None, picture: Path | None,
            every: bool, output: Path | None, verbose: bool, **values: Any) -> int:
    """Find the physical effects that are missing in a loop's model, add them, and watch the error fall.

    Starts from gain, one lag and offset; tries every effect at its place in the loop; keeps one only when it also
    predicts samples that the fit did not see. "Nothing is missing" is a normal answer.

    Exit status: 0 done; 2 wrong use, or the loop cannot be explained; 3 with --all: done, but some loop could not be.
    """
    from ..api import save_model as keep
    from ..effects.registry import load_effect
    from ..model import explain as explain_record
    from ..reporter.explain_report import judged, write_picture

    export, workers = Export.of(values), Workers.of(values)
    engine = None if workers.engine == "local" else workers.engine
    of_one = {"--loop": loop, "--add": add, "--model": model_file, "--save-model": save_model, "--json": json_file,
              "--html": html, "--picture": picture}
    of_all = {"--output": output, "--jobs": workers.jobs, "--sample": export.reading.sample, "--loops-matching":
              export.reading.loops_matching, "--engine": engine, "--scheduler": workers.scheduler}
    given = [name for name, value in (of_one if every else of_all).items() if value]
    if given and every:
        raise UsageError(f"{', '.join(given)} and --all do not fit together", where="--all",
                         remedy="--all explains every loop by search and writes --output")
    if given:
        raise UsageError(f"{given[0]} goes with --all", where=given[0],
                         remedy="add --all; for one loop there are --json, --html and --save-model")
    check_places(export, picture, json_file, html, save_model, output)
    more, chosen = ([load_effect(name) for name in names] for names in (outside, add))
    if every:
        return explain_plant(export, outside, output, workers)
    record, model = record_and_model(export, loop, model_file, other_loop=other_loop)
    found = explain_record(record, model, add=chosen, effects=more)
    if save_model is not None and found.model is not None:
        keep(found.model, save_model)
        say(f"model written to {save_model}")
    if picture is not None:
        write_picture(found, picture)
        say(f"picture written to {picture}")
    return deliver(judged(found), json_file, html, verbose=verbose)


def check_places(export: Export, picture: Path | None, *outputs: Path | None) -> None:
    """Refuse a name that no picture can have, and to write a result over the export it comes from."""
    from ..reporter.explain_report import check_picture

    check_picture(picture)
    for output in (picture, *outputs):
        if output is not None and any(p.is_file() and output.resolve() == p.resolve() for p in export.inputs):
            raise UsageError("this is the export itself", where=str(output), remedy="choose another name")


def record_and_model(export: Export, name: str | None, model_file: Path | None, *, other_loop: bool
                     ) -> tuple[Record, Model | None]:
    """Read one loop and its model: the loop called `name`, else that of the model, else the only one there is.

    Raises UsageError listing the loops where it is open, and when the model belongs to another loop or other ranges.
    """
    from ..api import load_model

    if model_file is None or other_loop:
        return one_loop(export, name), None if model_file is None else load_model(model_file)
    model, where = load_model(model_file), str(model_file)
    try:
        record = one_loop(export, name or model.loop)
    except UsageError as error:
        if name is not None or "no loop" not in error.what:
            raise
        raise UsageError(f"this model is of loop {model.loop}, which is not in this export", where=where,
                         remedy=f"{error.remedy}; --loop NAME --other-loop uses it for another loop") from error
    if model.loop.strip().lower() != record.loop.strip().lower():
        raise UsageError(f"this model is of loop {model.loop}, not of {record.loop}", where=where,
                         remedy=f"give --loop {model.loop}, or --other-loop to use it all the same")
    s = record.settings
    for key, kept, now in (("pv_range", model.pv_range, s.pv_range), ("op_range", model.op_range, s.op_range)):
        # a range guessed from the data gives way to the model's
        if kept is not None and tuple(kept) != tuple(now) and s.source.get(key) != "data":
            raise UsageError(
                f"the model's numbers belong to {key} = [{kept[0]:g}, {kept[1]:g}], this record is read with "
                f"[{now[0]:g}, {now[1]:g}]", where=where,
                remedy=f"set {key} of {record.loop} in its loops.toml as in the model, or fit the model anew; "
                       "--other-loop uses it all the same",
            )
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
    names = names_in(plant)
    shown = ", ".join(names[:20]) + (f" and {len(names) - 20} more" if len(names) > 20 else "")
    what = "several loops here" if name is None else f"{name!r} means several loops"
    raise UsageError(f"{what}: {shown}", where="--loop", remedy=f"choose one, for example --loop {names[0]}")


def names_in(plant: Plant) -> list[str]:
    """Return the names of all loops of a plant, of those that could not be read as well."""
    lost = (str(note.values["loop"]) for note in plant.failures if "loop" in note.values)
    return sorted({*(record.loop for record in plant), *lost})


def explain_plant(export: Export, effects: tuple[str, ...], output: Path | None, workers: Workers) -> int:
    """Explain every loop and write the summary to a file or folder, or show it; 3 when a loop could not be."""
    from ..engines.local import answers
    from ..model import explain as explain_record
    from ..record import Note
    from ..reporter.explain_report import judged, summary, to_csv
    from ..reporter.page import BACK, write_pages
    from ..reporter.templates import sentence
    from ..results import PlantExplanation

    folder = output is not None and output.suffix.lower() not in SUFFIXES
    if output is not None and output.exists() and output.is_dir() != folder:
        raise UsageError(f"this is {'a file' if folder else 'a folder'}", where=f"--output {output}",
                         remedy=f"give a file ending in {', '.join(SUFFIXES[:3])}, or a folder")
    plant = export.read()
    names = names_in(plant)
    kept: list[Explanation] = []
    lost: list[Note] = []

    def so_far() -> PlantExplanation:
        return PlantExplanation(tuple(kept), plant.inputs, plant.warnings, (*plant.failures, *lost))

    def pages() -> Iterator[tuple[str, dict[str, str]]]:
        """Keep each explanation without its series; give page and numbers of its loop for a folder."""
        work = partial(explain_record, effects=effects)
        for result in answers(plant.records, work, jobs=workers.jobs, client=client):
            if isinstance(result, Note):
                lost.append(result)
            else:
                kept.append(result.light())
                if folder:
                    report = judged(result)
                    yield result.loop, {"html": report.page(**BACK), "json": report.json()}
            step()

    with workers.client() as client, progress("explaining", len(names),
                                              stopped="loops were explained; no summary was written") as step:
        if folder and output is not None:
            write_pages(output, (plant.inputs, export.reading), names, pages(),
                        lambda **where: summary(so_far()).page(**where))
        else:
            list(pages())
    found, report = so_far(), summary(so_far())
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
