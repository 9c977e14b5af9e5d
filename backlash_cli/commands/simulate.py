"""backlash simulate: a record with known truth from the closed-loop simulator."""

from __future__ import annotations

from pathlib import Path

import click


@click.command(epilog="\b\nExamples:\n  backlash simulate example-2 --dead-band 0.03 --out example.csv\n"
               "  backlash simulate example-2 --show > mine.toml\n"
               "  backlash simulate mine.toml --out mine.parquet && backlash scan mine.parquet")
@click.argument("scenario", metavar="SCENARIO")
@click.option("--out", "--output", "-o", metavar="FILE", type=click.Path(path_type=Path),
              help="Where to write: .csv, .csv.gz or .parquet. Settings go to STEM.loops.toml beside it.")
@click.option("--truth", metavar="FILE", type=click.Path(path_type=Path),
              help="Where to write what was planted. Default: STEM.truth.csv beside --out.")
@click.option("--layout", metavar="LAYOUT", type=click.Choice(["wide", "long"]), default="wide", show_default=True,
              help="wide: a column per signal; long: tag, timestamp, value.")
@click.option("--dead-band", metavar="D", type=click.FloatRange(0.0, 0.5),
              help="Dead band of every loop's valve in spans of output (0.03 = 3 %), instead of the scenario's.")
@click.option("--seed", metavar="N", type=click.IntRange(0), help="Other random numbers.")
@click.option("--resolution", metavar="R", type=click.FloatRange(1e-9, 0.1), default=1e-6, show_default=True,
              help="Round the numbers to this part of their span.")
@click.option("--show", is_flag=True, help="Print the scenario's TOML file, to start your own from.")
@click.option("--force", is_flag=True, help="Replace files that exist.")
def simulate(scenario: str, out: Path | None, truth: Path | None, layout: str, dead_band: float | None,
             seed: int | None, resolution: float, show: bool, force: bool) -> int:  # fmt: skip
    """Simulate a control loop and write its record as a historian would export it.

    \b
    SCENARIO is the path of your own TOML file, or one of these names:
    example-1, example-2, industrial-fixed, industrial-oscillating (the paper's), sample-plant,
    workbench-monday, workbench-tuesday (of the tutorial)
    """
    from ..errors import UsageError
    from ..reporter.plant_files import stem_of, write_plant, write_settings, write_truth
    from ..simulator import simulate as run
    from ..simulator.scenario import truth_rows
    from ..simulator.scenario_file import load_scenarios, scenario_text, with_dead_band, with_seed

    if show:
        click.echo(scenario_text(scenario), nl=False)
        return 0
    if out is None:
        raise UsageError("nothing says where to write", remedy="add --out FILE, for example --out plant.csv")
    beside = out.with_name(stem_of(out))
    settings = beside.with_name(f"{beside.name}.loops.toml")
    truth = truth or beside.with_name(f"{beside.name}.truth.csv")
    there = [str(path) for path in (out, settings, truth) if path.exists()]
    if there and not force:
        raise UsageError(f"{', '.join(there)} exists", remedy="choose another --out, or add --force to replace it")
    loops = with_seed(with_dead_band(load_scenarios(scenario), dead_band), seed)
    records = [run(loop) for loop in loops]
    write_plant(out, records, layout=layout, finest=resolution)
    write_settings(settings, records)
    write_truth(truth, truth_rows(loops))
    size = f"{len(records)} loop{'s' * (len(records) != 1)}, {sum(map(len, records))} samples"
    click.echo(f"{size} -> {out}, {settings.name}, {truth.name}", err=True)
    return 0
