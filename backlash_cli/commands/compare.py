"""backlash compare: the model's prediction beside the measurement, and where they part."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from .options import inputs_argument, json_option, loops_option, reading_options

if TYPE_CHECKING:
    from ..loaders import ReadOptions


@click.command(epilog="\b\nExamples:\n  backlash compare sample_data/plant.csv --loop FIC109\n"
               "  backlash compare sample_data/plant.csv --loop FIC109 --html compare.html\n"
               "  backlash explain sample_data/plant.csv --loop FIC109 --save-model fic109.toml\n"
               "  backlash compare sample_data/plant.csv --model fic109.toml")
@inputs_argument
@click.option("--loop", metavar="NAME", help="The loop to look at. Default: the model's, or the only one there is.")
@click.option("--model", "model_file", metavar="FILE", type=click.Path(path_type=Path),
              help="Model file (TOML) as explain --save-model writes it. Default: the plain model (gain, one lag, "
              "offset; dead time where the settings give theta), fitted to this record.")
@click.option("--other-loop", is_flag=True, help="Use a model that was made for another loop or other ranges.")
@json_option
@click.option("--html", metavar="FILE", type=click.Path(path_type=Path),
              help="Draw measured and predicted PV, the residual and what it depends on.")
@click.option("--picture", metavar="FILE", type=click.Path(path_type=Path),
              help="Draw one still picture, .png or .svg, for a document or mail.")
@loops_option
@click.option("--verbose", "-v", is_flag=True, help="List every region of the record.")
@reading_options
def compare(inputs: tuple[Path, ...], loop: str | None, model_file: Path | None, other_loop: bool,
            json_file: Path | None, html: Path | None, picture: Path | None, loops: Path | None, verbose: bool,
            reading: ReadOptions) -> int:
    """Predict PV from the measured OP, compare it with the measured PV, and say where the model fails.

    INPUT is one or more CSV or Parquet files, or folders of them; they must hold the controller output (OP). The
    error is given for the fit, for samples the fit did not see, and beside the measurement noise.
    """
    from ..model import compare as compare_with
    from ..reporter.explain_report import check_picture, compare_page, comparison_text
    from .one_loop import check_places, deliver, model_for, one_loop

    check_picture(picture)
    check_places(inputs, json_file, html, picture)
    record = one_loop(inputs, loop, loops, reading, None if other_loop else model_file)
    model = None if model_file is None else model_for(model_file, record, other_loop=other_loop)
    found = compare_with(record, model)
    deliver(found, compare_page, comparison_text, picture=picture, html=html, json_file=json_file, verbose=verbose)
    return 0
