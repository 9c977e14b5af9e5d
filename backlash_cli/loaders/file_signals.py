"""The signals of several files, and what is wrong with those that cannot be read."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from pyarrow.lib import ArrowException

from ..errors import BacklashError, InputError
from ..record import Note
from .layouts import series_of
from .lazy_tables import Lazily, lazy_table
from .long_tables import LongTable
from .options import ReadOptions
from .series import Series
from .sources import Source
from .tables import Table, read_table

READING_ERRORS = (BacklashError, ArrowException, UnicodeError, OverflowError, MemoryError, OSError, ValueError)
SOURCE = "of source"  # key of a value that only travels from a part to the whole


def signals_of(
    sources: Sequence[Source], options: ReadOptions, lazily: Lazily | None
) -> tuple[list[Series], list[Note], list[Note], BacklashError | None]:
    """Return the signals of all files, what was noticed, the files that could not be read, and the first reason."""
    found: list[Series] = []
    notes: list[Note] = []
    failures: list[Note] = []
    first_problem: BacklashError | None = None
    for source in sources:
        try:
            table: Table | LongTable | None = None
            if lazily is not None:
                table = lazy_table(source.path, options, source.partition, lazily)
            if table is None:
                table = read_table(source.path, options, source.partition)
                if lazily is not None and lazily.progress is not None and isinstance(source.path, Path):
                    lazily.progress(source.path.stat().st_size)
            found += table.series if isinstance(table, LongTable) else series_of(table, options)
            notes += table.notes if options.share is None else [_of_source(note, source) for note in table.notes]
        except READING_ERRORS as caught:
            error = as_input_error(caught, str(source.path))
            first_problem = first_problem or error
            failures.append(failure(error, file=str(source.path)))
    return found, notes, failures, first_problem


def _of_source(note: Note, source: Source) -> Note:
    """The note with its file, by which the notes of several parts of a plant are put in order."""
    return Note(note.code, note.message, {**note.values, SOURCE: str(source.path)})


def as_input_error(error: BaseException, where: str) -> BacklashError:
    """Return what went wrong with a file as an error that says where."""
    if isinstance(error, BacklashError):
        return error
    text = str(error).strip().split("\n")[0][:200] or type(error).__name__
    return InputError(f"damaged or not understood: {text}", where=where, remedy="export the file again")


def failure(error: BacklashError, *, loop: str = "", file: str = "") -> Note:
    """Return an error as a failure of the plant, about a loop or a file."""
    values: dict[str, float | str] = {}
    if loop:
        values["loop"] = loop
    if file:
        values["file"] = file
    text = str(error)
    return Note(error.code, f"{loop}: {text}" if loop else text, values)
