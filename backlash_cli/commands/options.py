"""Options that several commands share: what to read, how to read it, where to write."""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click

F = TypeVar("F", bound=Callable[..., Any])


class Place(click.ParamType):
    """A path, or an address such as s3://bucket/plant.parquet."""

    name = "place"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return a Path, or a Remote for an address."""
        if isinstance(value, str) and ("://" in value or "::" in value):
            from ..loaders.remote import place

            return place(value)
        return Path(value)


inputs_argument = click.argument("inputs", metavar="INPUT...", nargs=-1, required=True, type=Place())
loops_option = click.option(
    "--loops", metavar="FILE", type=Place(),
    help="Loop settings (TOML or CSV table). Default: plant.loops.toml or loops.toml beside plant.csv.",
)

_READING = (  # flag, metavar, help
    ("--since", "TIME", "Only data from this time on: a date such as 2026-11-01 or 2026-11-01T06:00, or an age such as "
     "3d or 12h, back from the last time in the data."),
    ("--time-format", "FORMAT", "How times are written: dmy, mdy, ymd, iso, epoch_s, epoch_ms, excel, or a "
     "pattern such as '%d.%m.%Y %H:%M:%S'."),
    ("--timezone", "ZONE", "Zone of times without offset, e.g. Europe/Berlin. Default: UTC."),
    ("--interpolation", "hold|linear", "Between recorded values. Default: PV linear, the others hold."),
    ("--delimiter", "CHAR", "Between the columns: comma, semicolon, tab, pipe, space or a character."),
    ("--decimal", "CHAR", "Decimal mark: . or ,"),
    ("--encoding", "NAME", "Text encoding, e.g. utf-16 or cp1252."),
    ("--layout", "NAME", "Arrangement: wide, single, long or pairs."),
    ("--columns", "A,B,...", "Names of the columns of a file without a header line."),
    ("--header-row", "N", "Number (from 1) of the line that names the columns."),
    ("--good-quality", "WORD", "Further quality word or number that means good; may be repeated."),
    ("--auto-mode", "WORD", "Further MODE word or number that means automatic; may be repeated."),
)
_KINDS: dict[str, dict[str, Any]] = {
    "--header-row": {"type": int},
    "--good-quality": {"multiple": True},
    "--auto-mode": {"multiple": True},
}
_FIELDS = {"auto_mode": "auto_modes"}


def reading_options(command: F) -> F:
    """Add the options on how to read exports; the command receives them as `reading`, a ReadOptions."""

    @functools.wraps(command)
    def with_reading(**values: Any) -> Any:
        from ..loaders import ReadOptions

        chosen: dict[str, Any] = {}
        for flag, _, _ in _READING:
            name = flag[2:].replace("-", "_")
            value = values.pop(name)
            if name == "columns":
                value = tuple(c.strip() for c in value.split(",")) if value else ()
            chosen[_FIELDS.get(name, name)] = value
        return command(reading=ReadOptions(**chosen), **values)

    decorated: Any = with_reading
    for flag, metavar, words in reversed(_READING):
        decorated = click.option(flag, metavar=metavar, help=words, **_KINDS.get(flag, {}))(decorated)
    return decorated


_SELECTION = (
    click.option("--loops-matching", metavar="PATTERN", multiple=True,
                 help="Only loops with such a name: wildcards ('FIC*') or a regular expression between slashes "
                 "('/^FIC1[0-4]/'); may be repeated. The others are counted in the report."),
    click.option("--sample", metavar="N|P%",
                 help="Only so many of the loops, or this share of them, drawn by their names: the same ones every "
                 "time. The report names them."),
    click.option("--sample-seed", metavar="N", type=int, default=0, help="Another number draws another sample."),
)


def selection_options(command: F) -> F:
    """Add the options on which loops to compute; they become part of `reading`. Goes below `reading_options`."""

    @functools.wraps(command)
    def with_selection(reading: Any, **values: Any) -> Any:
        from dataclasses import replace

        chosen = {name: values.pop(name) for name in ("loops_matching", "sample", "sample_seed")}
        return command(reading=replace(reading, **chosen), **values)

    decorated: Any = with_selection
    for option in reversed(_SELECTION):
        decorated = option(decorated)
    return decorated
