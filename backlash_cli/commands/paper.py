"""backlash paper: the publication's numbers and figures, recomputed."""

from __future__ import annotations

from pathlib import Path

import click


@click.command(epilog="\b\nExamples:\n  backlash paper\n  backlash paper --html paper.html")
@click.option("--html", metavar="FILE", type=click.Path(path_type=Path), help="Draw each figure beside its numbers.")
@click.option("--json", "json_file", metavar="FILE", type=click.Path(path_type=Path),
              help="Write the rows as JSON; - is standard output.")
def paper(html: Path | None, json_file: Path | None) -> int:
    """Recompute every number of Haegglund (2007): the paper's, ours, the difference, and why where they differ.

    Shows what the method can do and where the paper's own figures cannot be reproduced. Takes a few seconds and needs
    no input.
    """
    import sys

    from ..estimator.haegglund import published_estimates
    from ..reporter.paper import paper_page, to_json, to_text
    from ..simulator.paper import reproduce
    from .terminal import emit, put

    report = reproduce(published_estimates)
    if json_file is not None:
        put(json_file, to_json(report), "rows")
    if html is not None:
        put(html, paper_page(report), "page")
    if str(json_file) != "-":
        emit(to_text(report, colour=sys.stdout.isatty()))
    return 0
