"""backlash scan: from historian exports to one verdict per loop, with its reasons."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from .options import (
    engine_options,
    inputs_argument,
    loops_option,
    only_loops_option,
    reading_options,
    selection_options,
    working,
)
from .terminal import emit, progress, say

if TYPE_CHECKING:
    from ..loaders import ReadOptions
    from ..results import ScanResult
    from .run_scan import Job

FORMATS = ("table", "json", "csv", "parquet", "html")


@click.command(epilog="\b\nExamples:\n  backlash scan sample_data/plant.csv\n"
               "  backlash scan sample_data/plant.csv --format html --output report.html\n"
               "  backlash scan sample_data/plant.csv --fail-on 'd>3%' --format csv --output loops.csv")
@inputs_argument
@loops_option
@only_loops_option
@click.option("--format", "form", metavar="FORMAT", type=click.Choice(FORMATS),
              help="table, json, csv, parquet or html. Default: after the suffix of --output, else table.")
@click.option("--output", "-o", metavar="FILE|DIR", type=click.Path(path_type=Path),
              help="Write the report here, whole or not at all. With html, a name without .html is a folder with a "
              "page per loop, for many loops.")
@click.option("--table", metavar="NAME", default="loops",
              help="For csv and parquet: loops (a row per loop) or estimates (a row per half period).")
@click.option("--plot", metavar="DIR", type=click.Path(path_type=Path),
              help="Also draw a picture (PNG) of each loop's evidence into this folder.")
@click.option("--history", metavar="DB", type=click.Path(path_type=Path),
              help="Also add the result to this history (one SQLite file), made where it does not exist. Scanning the "
              "same data again changes nothing.")
@click.option("--resume", is_flag=True,
              help="With --history: go on with the same scan where it was stopped, killed or cut off. Loops that it "
              "had finished are taken over unless their files, settings or options have changed.")
@click.option("--fail-on", metavar="RULE", multiple=True,
              help="Exit status 1 when a loop meets the rule: backlash, suspected (or worse), oscillating, "
              "cannot_tell, insufficient_data, error, any (of the first three), or a size such as d>0.03 or d>3%. "
              "Several: with commas, or given again.")
@click.option("--no-confirm", is_flag=True, help="Skip the test of PV against OP; faster, less sure.")
@click.option("--jobs", metavar="N", type=click.IntRange(min=1),
              help="Processes. Default: as many as the input is worth.")
@click.option("--verbose", "-v", is_flag=True, help="List every reason and warning of every loop.")
@click.option("--quiet", "-q", is_flag=True,
              help="Say only what went wrong: no progress, and no table unless --format asks for it.")
@engine_options
@reading_options
@selection_options
def scan(inputs: tuple[Path, ...], loops: Path | None, form: str | None, output: Path | None, table: str,
         plot: Path | None, history: Path | None, resume: bool, fail_on: tuple[str, ...], no_confirm: bool,
         jobs: int | None, verbose: bool, quiet: bool, engine: str, scheduler: str | None,
         reading: ReadOptions) -> int:
    """Find dead band in every loop of an export and say how much, how sure, and what to do.

    INPUT is one or more CSV or Parquet files, or folders of them; together they are one plant.

    Exit status: 0 done; 1 a --fail-on rule was met; 2 wrong use, or nothing could be read; 3 done, but some file or
    loop could not be analysed. When both 1 and 3 apply it is 1.
    """
    from ..reporter.scan_report import check_delivery, draw, met, parse_rules
    from ..scanning import ScanOptions
    from .run_scan import Job, kept, remember

    rules = parse_rules(fail_on)
    form = check_delivery(form, output, table)
    options = ScanOptions(confirm=not no_confirm, carry=history is not None)
    with kept(history, (inputs, loops, reading, options), resume=resume) as keep:
        with working(engine, scheduler, jobs) as client:
            job = Job(inputs, loops, reading, options, jobs, client, not quiet, keep)
            result = job.scan()
            if history is not None:
                remember(result, history, job)
        if not (quiet and form is None):
            _deliver(result, job, form or "table", output, table, verbose=verbose)
        if plot is not None:
            with progress("drawing", len(job.records), shown=job.shown) as step:
                count = draw(result, job.records, plot, step)
            if job.shown:
                say(f"{count} picture{'s' * (count != 1)} written to {plot}")
    wrong = _wrong(result)
    if quiet or output is not None or form not in (None, "table"):
        for message in wrong:
            say(f"not analysed: {message}")
    hits = met(rules, result.loops)
    if hits and not quiet:
        say(f"--fail-on {', '.join(fail_on)}: met by {len(hits)} loop{'s' * (len(hits) != 1)}: {', '.join(hits[:10])}")
    return 1 if hits else 3 if wrong else 0


def _wrong(result: ScanResult) -> list[str]:
    """What could not be read or analysed: files, and loops with the verdict `error`."""
    loops = [note.message for r in result.loops if r.verdict == "error" for note in r.reasons[:1]]
    return [note.message for note in result.failures] + loops


def _deliver(result: ScanResult, job: Job, form: str, output: Path | None, table: str, *, verbose: bool) -> None:
    from ..reporter.scan_report import render, write

    records = job.records if form == "html" else {}
    if output is None:
        import sys

        emit("".join(render(result, records, form, table, verbose=verbose, colour=sys.stdout.isatty())))
        return
    with progress("writing", None, shown=job.shown) as step:
        write(result, records, form, output, table, verbose=verbose, step=step)
    if job.shown:
        say(f"{len(result.loops)} loop{'s' * (len(result.loops) != 1)} scanned, {form} written to {output}")
