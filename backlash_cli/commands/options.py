"""Options that several commands share, each declared once: what to read and how, where to write, where to work."""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ..errors import UsageError
from .terminal import progress, say, say_if_first_run

if TYPE_CHECKING:
    from distributed import Client

    from ..loaders import Plant, ReadOptions

Option = Callable[[Callable[..., Any]], Callable[..., Any]]


@dataclass(frozen=True)
class Export:
    """What a command reads: files, folders or addresses, the file of loop settings, and how to read them."""

    inputs: tuple[Path, ...]
    loops: Path | None
    reading: ReadOptions

    @classmethod
    def of(cls, given: dict[str, Any]) -> Export:
        """Return what the options added by `export` were given."""
        from ..loaders import ReadOptions

        reading = {name: given[name] for name in ReadOptions.__dataclass_fields__ if name in given}
        return cls(given["inputs"], given["loops"], ReadOptions(**reading))

    def read(self, *, compiles: bool = True, **changes: Any) -> Plant:
        """Read the whole plant. compiles: whether what follows does. changes: of the options on how to read."""
        from ..loaders import read

        if compiles:
            say_if_first_run()
        with progress("reading", None):
            return read(self.inputs, loops=self.loops, options=replace(self.reading, **changes))


@dataclass(frozen=True)
class Workers:
    """Where the work is done: processes of this machine, or a Dask cluster."""

    engine: str
    scheduler: str | None
    jobs: int | None

    @classmethod
    def of(cls, given: dict[str, Any]) -> Workers:
        """Return what the options of ENGINE, and --jobs where it is there, were given."""
        return cls(given["engine"], given["scheduler"], given.get("jobs"))

    @contextlib.contextmanager
    def client(self) -> Iterator[Client | None]:
        """Give the client of the cluster for the time of the block, None for this machine.

        Raises UsageError for what does not fit together, and when Dask is wanted and missing.
        """
        if self.scheduler is not None and self.engine != "dask":
            raise UsageError("--scheduler goes with --engine dask", where="--scheduler", remedy="add --engine dask")
        if self.scheduler is not None and self.jobs is not None:
            raise UsageError("the cluster has the workers it has", where="--jobs",
                             remedy="leave --jobs out with --scheduler")
        if self.engine != "dask":
            yield None
            return
        from ..engines.cluster import connected

        with connected(self.scheduler, self.jobs, say) as client:
            yield client


def size(text: str, where: str, what: str, remedy: str) -> tuple[float, bool]:
    """Read a size as a person writes it, `0.03` or `3%`: the number, parts of one for percent, and whether it was that.

    Raises UsageError, naming the option `where`, for what is no number or not above 0.
    """
    try:
        value = float(text.removesuffix("%")) / (100.0 if text.endswith("%") else 1.0)
    except ValueError:
        raise UsageError(f"'{text}' is not a {what}", where=where, remedy=remedy) from None
    if not 0.0 < value < float("inf"):
        raise UsageError(f"a {what} of {text} allows nothing", where=where, remedy=f"more than 0: {remedy}")
    return value, text.endswith("%")


def dead_band(text: str | None, where: str = "--dead-band") -> float | None:
    """Read a dead band in spans of the output, None for none. Raises UsageError for one above half of the span.

    >>> dead_band("0.03"), dead_band("3 %")
    (0.03, 0.03)
    """
    if text is None:
        return None
    found, _ = size(text, where, "size", remedy := "0.03 or 3% is 3 % of the output span")
    if found > 0.5:
        raise UsageError(f"{text} is not possible", where=where, remedy=f"at most 0.5; {remedy}")
    return found


def together(*options: Option) -> Option:
    """Several options as one."""
    return lambda command: functools.reduce(lambda made, option: option(made), reversed(options), command)


class Place(click.ParamType):
    """A path, or an address such as s3://bucket/plant.parquet."""

    name = "place"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return a Path, or a Remote for an address."""
        if isinstance(value, str) and ("://" in value or "::" in value):
            from ..loaders.sources import place

            return place(value)
        return Path(value)


def path(*names: str, help: str, metavar: str = "FILE", **more: Any) -> Option:
    """An option that takes the path of a file."""
    return click.option(*names, metavar=metavar, type=click.Path(path_type=Path), help=help, **more)


def output(help: str = "Write to this file instead.", metavar: str = "FILE", **more: Any) -> Option:
    """The option that names the file of the report."""
    return path("--output", "-o", metavar=metavar, help=help, **more)


def verbose(help: str) -> Option:
    """The option for all there is to say."""
    return click.option("--verbose", "-v", is_flag=True, help=help)


def _names(context: click.Context, option: click.Parameter, value: str | None) -> tuple[str, ...]:
    return tuple(name.strip() for name in value.split(",")) if value else ()


JSON = path("--json", "json_file", help="Write everything as JSON; - is standard output.")
JOBS = click.option("--jobs", metavar="N", type=click.IntRange(min=1),
                           help="Processes. Default: as many as the input is worth, at most one per core.")
ONLY_LOOPS = click.option("--loop", "only_loops", metavar="NAME", multiple=True,
                          help="Only this loop; may be repeated, with wildcards such as 'FIC*'.")
_READING = (
    click.option("--loops", metavar="FILE", type=Place(), help="Loop settings (TOML or CSV table). Default: "
                 "plant.loops.toml or loops.toml beside plant.csv."),
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
SELECTION = (
    click.option("--loops-matching", metavar="PATTERN", multiple=True,
                 help="Only loops with such a name: wildcards ('FIC*') or a regular expression between slashes "
                 "('/^FIC1[0-4]/'); may be repeated. The others are counted in the report."),
    click.option("--sample", metavar="N|P%",
                 help="Only so many of the loops, or this share of them, drawn by their names: the same ones every "
                 "time. The report names them."),
    click.option("--sample-seed", metavar="N", type=int, default=0, help="Another number draws another sample."),
)
ENGINE = together(
    click.option("--engine", metavar="local|dask", type=click.Choice(["local", "dask"]), default="local",
                 help="Where the work is done: processes of this machine (default), or the workers of a Dask cluster; "
                 "without --scheduler a cluster of --jobs processes on this machine."),
    click.option("--scheduler", metavar="ADDRESS",
                 help="With --engine dask: the scheduler of a running cluster, such as tcp://host:8786."),
)


def export(*more: Option, required: bool = True) -> Option:
    """Add INPUT, `more` options on which loops, and those on how to read: all that `Export.of` takes."""
    argument = click.argument("inputs", metavar="INPUT...", nargs=-1, required=required, type=Place())
    return together(argument, *more, *_READING)
