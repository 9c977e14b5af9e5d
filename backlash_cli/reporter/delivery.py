"""One report in the form that was asked for: as text for standard output, or written whole to a file or folder."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

from ..errors import UsageError
from ..record import Record
from ..results import ScanResult
from .files import make_folder, replacing, write_parts
from .safe import file_names

_SUFFIXES = {".json": "json", ".csv": "csv", ".parquet": "parquet", ".html": "html", ".htm": "html", ".txt": "table"}


def check_delivery(form: str | None, output: Path | None, table: str) -> str | None:
    """Return the form to write, from `form` or else the suffix of `output`; None when neither says.

    Raises UsageError for what cannot be, before any work is done.
    """
    from .tables import TABLES

    if table not in TABLES:
        raise UsageError(f"no table {table!r}", where="--table", remedy=f"one of: {', '.join(TABLES)}")
    if form is None and output is not None:
        form = _SUFFIXES.get(output.suffix.lower(), "table")
    if form == "parquet" and output is None:
        raise UsageError("Parquet is not for a terminal", where="--format parquet", remedy="add --output FILE.parquet")
    if table != "loops" and form not in ("csv", "parquet"):
        raise UsageError(
            "there are tables in CSV and Parquet only", where=f"--table {table}", remedy="add --format csv"
        )
    if output is not None and form != "html" and output.is_dir():
        raise UsageError("this is a folder", where=f"--output {output}", remedy="give the name of a file")
    return form


def render(
    result: ScanResult, records: Mapping[str, Record], form: str, table: str = "loops", *, verbose: bool = False,
    colour: bool = False,
) -> Iterator[str]:
    """Return the report as text in one of the forms table, json, csv, html; piece by piece, loop by loop."""
    if form == "json":
        from .json_report import json_parts

        return json_parts(result)
    if form == "csv":
        from .tables import csv_parts

        return csv_parts(result, table)
    if form == "html":
        from .html import single_page

        return iter([single_page(result, records)])
    from .text import to_text

    return iter([to_text(result, verbose=verbose, colour=colour)])


def draw(
    result: ScanResult, records: Mapping[str, Record], folder: Path, step: Callable[[], None] = lambda: None
) -> int:
    """Draw a picture (PNG) of each loop's evidence into `folder`, made if need be; return how many.

    Loops that could not be read have no record and no picture. Raises BacklashError when the place cannot be written.
    """
    from .pictures import draw_loop

    make_folder(folder)
    reports = [r for r in result.loops if r.loop in records and r.samples]
    names = file_names(r.loop for r in reports)
    drawn = 0
    for r in reports:
        if (record := records.get(r.loop)) is not None:
            draw_loop(record, r, folder, name=names[r.loop])
            drawn += 1
        step()
    return drawn


def write(
    result: ScanResult, records: Mapping[str, Record], form: str, output: Path, table: str = "loops", *,
    verbose: bool = False, step: Callable[[], None] = lambda: None,
) -> None:
    """Write the report to a file, or as pages to a folder; the old report stays until the new one is whole.

    Raises BacklashError when the place cannot be written.
    """
    if form == "parquet":
        from .tables import write_parquet

        with replacing(output) as temporary:
            write_parquet(result, temporary, table)
    elif form == "html" and output.suffix.lower() not in (".html", ".htm"):
        from .html import write_folder

        write_folder(output, result, records, step)
    else:
        write_parts(output, render(result, records, form, table, verbose=verbose))
