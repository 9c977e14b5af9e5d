"""backlash explain: which physical effect is missing, how the error falls when it is added, and what is left."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from .options import engine_options, inputs_argument, loops_option, reading_options, selection_options
from .terminal import say

if TYPE_CHECKING:
    from ..loaders import ReadOptions


@click.command(epilog="\b\nExamples:\n  backlash explain sample_data/plant.csv --loop FIC109\n"
               "  backlash explain sample_data/plant.csv --loop FIC109 --html explain.html --save-model fic109.toml\n"
               "  backlash explain sample_data/plant.csv --all --output effects.csv")
@inputs_argument
@click.option("--loop", metavar="NAME", help="The loop to explain. Default: the model's, or the only one there is.")
@click.option("--add", metavar="EFFECT", multiple=True,
              help="Your own choice instead of the search: add this effect (backlash effects lists them); may be "
              "repeated. module:NAME is one from outside.")
@click.option("--effect", "outside", metavar="MODULE:NAME", multiple=True,
              help="Also try this effect of your own in the search; may be repeated.")
@click.option("--model", "model_file", metavar="FILE", type=click.Path(path_type=Path),
              help="Go on from this model file (TOML): its effects stay, their numbers are refitted.")
@click.option("--other-loop", is_flag=True, help="Use a model that was made for another loop or other ranges.")
@click.option("--save-model", metavar="FILE", type=click.Path(path_type=Path),
              help="Keep the final model as TOML, to edit by hand, go on with, or compare with another day.")
@click.option("--json", "json_file", metavar="FILE", type=click.Path(path_type=Path),
              help="Write everything as JSON; - is standard output.")
@click.option("--html", metavar="FILE", type=click.Path(path_type=Path),
              help="Draw the ladder, each step over the measurement.")
@click.option("--all", "every", is_flag=True, help="Explain every loop of the plant and write a summary.")
@click.option("--output", "-o", metavar="FILE|DIR", type=click.Path(path_type=Path),
              help="With --all: the summary as .csv, .json or .html, or a folder with all three and the JSON of "
              "each loop. Default: a table on the terminal.")
@click.option("--jobs", metavar="N", type=click.IntRange(min=1), help="With --all: processes. Default: one per core.")
@click.option("--picture", metavar="FILE", type=click.Path(path_type=Path),
              help="Draw one still picture, .png or .svg, for a document or mail.")
@loops_option
@click.option("--verbose", "-v", is_flag=True, help="List every candidate with its numbers, and every region.")
@engine_options
@reading_options
@selection_options
def explain(inputs: tuple[Path, ...], loop: str | None, add: tuple[str, ...], outside: tuple[str, ...],
            model_file: Path | None, other_loop: bool, save_model: Path | None, json_file: Path | None,
            html: Path | None, picture: Path | None, every: bool, output: Path | None, jobs: int | None,
            loops: Path | None, verbose: bool, engine: str, scheduler: str | None, reading: ReadOptions) -> int:
    """Find the physical effects that are missing in a loop's model, add them, and watch the error fall.

    Starts from gain, one lag and offset; tries every effect at its place in the loop; keeps one only when it also
    predicts samples that the fit did not see. "Nothing is missing" is a normal answer.

    Exit status: 0 done; 2 wrong use, or the loop cannot be explained; 3 with --all: done, but some loop could not be.
    """
    from ..effects.registry import load_effect
    from .one_loop import check_places, check_together, deliver, model_for, one_loop

    check_together(every=every, plant={"--output": output, "--jobs": jobs, "--sample": reading.sample,
                                       "--loops-matching": reading.loops_matching,
                                       "--engine": None if engine == "local" else engine,
                                       "--scheduler": scheduler}, single={
        "--loop": loop, "--add": add, "--model": model_file, "--save-model": save_model, "--json": json_file,
        "--html": html, "--picture": picture,
    })
    check_places(inputs, json_file, html, picture, save_model, output)
    more = [load_effect(name) for name in outside]
    chosen = [load_effect(name) for name in add]
    if every:
        from .explain_all import explain_plant

        return explain_plant(inputs, loops, reading, outside, output, jobs, engine, scheduler)
    from ..api import save_model as keep
    from ..model import explain as explain_record
    from ..reporter.explain_report import check_picture, explain_page, explanation_text

    check_picture(picture)
    record = one_loop(inputs, loop, loops, reading, None if other_loop else model_file)
    model = None if model_file is None else model_for(model_file, record, other_loop=other_loop)
    found = explain_record(record, model, add=chosen, effects=more)
    if save_model is not None and found.model is not None:
        keep(found.model, save_model)
        say(f"model written to {save_model}")
    deliver(found, explain_page, explanation_text, picture=picture, html=html, json_file=json_file, verbose=verbose)
    return 0
