"""The part of `backlash explain` that goes over every loop of a plant and writes the summary."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import UsageError
from .options import working
from .terminal import progress, put, say

if TYPE_CHECKING:
    from ..loaders import ReadOptions
    from ..results import Explanation, PlantExplanation

SUFFIXES = (".csv", ".json", ".html", ".htm", ".txt")


def explain_plant(inputs: tuple[Path, ...], loops: Path | None, reading: ReadOptions, effects: tuple[str, ...],
                  output: Path | None, jobs: int | None, engine: str, scheduler: str | None) -> int:
    """Explain every loop and write the summary to a file or folder, or show it; 3 when a loop could not be."""
    from ..engines.explain_all import explain_all
    from ..loaders import read
    from ..record import Note
    from ..results import PlantExplanation

    folder = output is not None and output.suffix.lower() not in SUFFIXES
    if output is not None and output.exists() and output.is_dir() != folder:
        kind = "a file" if folder else "a folder"
        raise UsageError(f"this is {kind}", where=f"--output {output}",
                         remedy=f"give a file ending in {', '.join(SUFFIXES[:3])}, or a folder")
    plant = read(list(inputs), loops=loops, options=reading)
    names = sorted({*(record.loop for record in plant), *(str(n.values["loop"]) for n in plant.failures
                                                         if "loop" in n.values)})
    kept: list[Explanation] = []
    lost: list[Note] = []

    def summary() -> PlantExplanation:
        return PlantExplanation(tuple(kept), (*plant.failures, *lost), plant.inputs, plant.warnings)

    def each() -> Iterator[Explanation]:
        """Yield each explanation whole, and keep it without its series."""
        for result in explain_all(plant.records, effects, jobs=jobs, client=client):
            if isinstance(result, Note):
                lost.append(result)
            else:
                kept.append(result.light())
                yield result
            step()

    try:
        with working(engine, scheduler, jobs) as client, progress("explaining", len(names), shown=True) as step:
            if folder and output is not None:
                _write_folder(output, names, each(), kept, summary, repr((plant.inputs, reading)))
            else:
                for _ in each():
                    continue
    except KeyboardInterrupt as stop:
        stop.add_note(f"{len(kept)} of {len(names)} loops were explained; no summary was written")
        raise
    _deliver(summary(), output, folder)
    return 3 if summary().failures else 0


def _write_folder(folder: Path, loops: Sequence[str], found: Iterator[Explanation], kept: list[Explanation],
                  summary: Callable[[], PlantExplanation], told: str) -> None:
    """Write a page per loop as it comes, then the index, the table and the numbers. told: what the report is about."""
    from ..reporter.explain_report import explain_page
    from ..reporter.explain_summary import to_page
    from ..reporter.files import write_text
    from ..reporter.json_report import model_json
    from ..reporter.page import links_to, write_pages
    from ..reporter.safe import file_names

    names = file_names(loops)
    back = ("../index.html", "All loops")
    pages = ((names[x.loop], explain_page(x, plotly_file="plotly.js", back=back)) for x in found)

    def index(subfolder: str) -> str:
        for x in kept:
            write_text(folder / subfolder / f"{names[x.loop]}.json", model_json(x))
        links = links_to({x.loop: names[x.loop] for x in kept}, subfolder)
        return to_page(summary(), links, plotly_file=f"{subfolder}/plotly.js")

    write_pages(folder, told, pages, index)


def _deliver(plant: PlantExplanation, output: Path | None, folder: bool) -> None:
    from ..reporter import explain_summary as summary

    if output is None:
        put(Path("-"), summary.to_text(plant, colour=sys.stdout.isatty()))
        return
    if folder:
        put(output / "summary.csv", summary.to_csv(plant), "table")
        put(output / "summary.json", summary.to_json(plant), "numbers")
    else:
        forms = {".csv": summary.to_csv, ".json": summary.to_json, ".txt": summary.to_text}
        put(output, forms.get(output.suffix.lower(), summary.to_page)(plant), "summary")
    say(summary.summary_line(plant))
    for note in plant.failures:
        say(f"not explained: {note.message}")
