"""Options that several commands share: what to read, how to read it, which loops, and where the work is done."""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, cast

import click

from ..errors import UsageError
from .terminal import say

if TYPE_CHECKING:
    from distributed import Client

F = TypeVar("F", bound=Callable[..., Any])


class Place(click.ParamType):
    """A path, or an address such as s3://bucket/plant.parquet."""

    name = "place"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return a Path, or a Remote for an address."""
        if isinstance(value, str) and ("://" in value or "::" in value):
            from ..loaders.sources import place

            return place(value)
        return Path(value)


inputs_argument = click.argument("inputs", metavar="INPUT...", nargs=-1, required=True, type=Place())
loops_option = click.option(
    "--loops", metavar="FILE", type=Place(),
    help="Loop settings (TOML or CSV table). Default: plant.loops.toml or loops.toml beside plant.csv.",
)

only_loops_option = click.option("--loop", "only_loops", metavar="NAME", multiple=True,
                                 help="Only this loop; may be repeated, with wildcards such as 'FIC*'.")
json_option = click.option("--json", "json_file", metavar="FILE", type=click.Path(path_type=Path),
                           help="Write the numbers as JSON; - is standard output.")


def _names(context: click.Context, option: click.Parameter, value: str | None) -> tuple[str, ...]:
    return tuple(name.strip() for name in value.split(",")) if value else ()


_READING = (
    click.option("--since", metavar="TIME", help="Only data from this time on: a date such as 2026-11-01 or "
                 "2026-11-01T06:00, or an age such as 3d or 12h, back from the last time in the data."),
    click.option("--time-format", metavar="FORMAT", help="How times are written: dmy, mdy, ymd, iso, epoch_s, "
                 "epoch_ms, excel, or a pattern such as '%d.%m.%Y %H:%M:%S'."),
    click.option("--timezone", metavar="ZONE", help="Zone of times without offset, e.g. Europe/Berlin. Default: UTC."),
    click.option("--interpolation", metavar="hold|linear",
                 help="Between recorded values. Default: PV linear, the others hold."),
    click.option("--delimiter", metavar="CHAR",
                 help="Between the columns: comma, semicolon, tab, pipe, space or a character."),
    click.option("--decimal", metavar="CHAR", help="Decimal mark: . or ,"),
    click.option("--encoding", metavar="NAME", help="Text encoding, e.g. utf-16 or cp1252."),
    click.option("--layout", metavar="NAME", help="Arrangement: wide, single, long or pairs."),
    click.option("--columns", metavar="A,B,...", callback=_names,
                 help="Names of the columns of a file without a header line."),
    click.option("--header-row", metavar="N", type=int, help="Number (from 1) of the line that names the columns."),
    click.option("--good-quality", metavar="WORD", multiple=True,
                 help="Further quality word or number that means good; may be repeated."),
    click.option("--auto-mode", "auto_modes", metavar="WORD", multiple=True,
                 help="Further MODE word or number that means automatic; may be repeated."),
)
_SELECTION = (
    click.option("--loops-matching", metavar="PATTERN", multiple=True,
                 help="Only loops with such a name: wildcards ('FIC*') or a regular expression between slashes "
                 "('/^FIC1[0-4]/'); may be repeated. The others are counted in the report."),
    click.option("--sample", metavar="N|P%",
                 help="Only so many of the loops, or this share of them, drawn by their names: the same ones every "
                 "time. The report names them."),
    click.option("--sample-seed", metavar="N", type=int, default=0, help="Another number draws another sample."),
)
_ENGINE = (
    click.option("--engine", metavar="local|dask", type=click.Choice(["local", "dask"]), default="local",
                 help="Where the work is done: processes of this machine (default), or the workers of a Dask cluster; "
                 "without --scheduler a cluster of --jobs processes on this machine."),
    click.option("--scheduler", metavar="ADDRESS",
                 help="With --engine dask: the scheduler of a running cluster, such as tcp://host:8786."),
)


def _with(command: F, options: Sequence[Callable[[F], F]]) -> F:
    for option in reversed(options):
        command = option(command)
    return command


def reading_options(command: F) -> F:
    """Add the options on how to read exports; the command receives whatever is a field of ReadOptions as `reading`."""

    @functools.wraps(command)
    def with_reading(**values: Any) -> Any:
        from ..loaders import ReadOptions

        chosen = {name: values.pop(name) for name in ReadOptions.__dataclass_fields__ if name in values}
        return command(reading=ReadOptions(**chosen), **values)

    return _with(cast(F, with_reading), _READING)


def selection_options(command: F) -> F:
    """Add the options on which loops to compute; they become part of `reading`. Goes below `reading_options`."""
    return _with(command, _SELECTION)


def engine_options(command: F) -> F:
    """Add --engine and --scheduler; the command receives them as `engine` and `scheduler`."""
    return _with(command, _ENGINE)


def check_engine(engine: str, scheduler: str | None, jobs: int | None = None) -> None:
    """Raise UsageError for what does not fit together, and when Dask is wanted and missing."""
    if scheduler is not None and engine != "dask":
        raise UsageError("--scheduler goes with --engine dask", where="--scheduler", remedy="add --engine dask")
    if scheduler is not None and jobs is not None:
        raise UsageError("the cluster has the workers it has", where="--jobs",
                         remedy="leave --jobs out with --scheduler")
    if engine == "dask":
        from ..engines.cluster import check_installed

        check_installed()


@contextlib.contextmanager
def working(engine: str, scheduler: str | None, jobs: int | None = None) -> Iterator[Client | None]:
    """Give the client of the cluster for the time of the block, None for the local engine."""
    check_engine(engine, scheduler, jobs)
    if engine != "dask":
        yield None
        return
    from ..engines.cluster import connected

    with connected(scheduler, jobs, say) as client:
        yield client
