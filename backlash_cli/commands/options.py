"""Commands and their options, made from the page `commands.toml`, and what options that several commands have mean."""

from __future__ import annotations

import contextlib
import math
import os
import sys
import tomllib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from importlib import import_module, resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ..errors import UsageError
from .terminal import progress, refusal, say, say_if_first_run

if TYPE_CHECKING:
    from distributed import Client

    from ..loaders import Plant, ReadOptions
    from ..places import Remote

TEXT_OR_JSON = {".txt": "table", ".json": "json"}  # how a file ends: what is written to it


@dataclass(frozen=True)
class Export:
    """What a command reads: files, folders or addresses, the file of loop settings, and how to read them."""

    inputs: tuple[Path, ...]
    loops: Path | None
    reading: ReadOptions

    @classmethod
    def of(cls, given: dict[str, Any]) -> Export:
        """Return what INPUT and the options on how to read were given."""
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


@contextlib.contextmanager
def cluster(given: Mapping[str, Any]) -> Iterator[Client | None]:
    """Give the client of a Dask cluster for the time of the block, None for this machine.

    given: what engine, scheduler and jobs, where they are options, were given. Raises UsageError for what does not fit
    together, and when Dask is wanted and missing."""
    scheduler, jobs = given["scheduler"], given.get("jobs")
    if scheduler is not None and given["engine"] != "dask":
        raise UsageError("this goes with --engine dask", where="--scheduler", remedy="add --engine dask")
    if scheduler is not None and jobs is not None:
        raise refusal(UsageError, "cluster_jobs", "--jobs")
    if given["engine"] != "dask":
        yield None
        return
    from ..engines.cluster import connected
    from ..engines.local import context_of_processes

    with connected(scheduler, jobs, say, "spawn" if scheduler else context_of_processes().get_start_method()) as client:
        yield client


def size(text: str, where: str, what: str, remedy: str, most: float = sys.float_info.max) -> tuple[float, bool]:
    """Read a size as a person writes it, `0.03` or `3%`: the number, parts of one for percent, and whether it was that.
    Raises UsageError, naming the option `where`, for what is no number, not above 0 or above `most`."""
    try:
        value = float(text.removesuffix("%")) / (100.0 if text.endswith("%") else 1.0)
    except ValueError:
        raise UsageError(f"'{text}' is not a {what}", where=where, remedy=remedy) from None
    if not 0.0 < value <= most:
        wrong, allowed = ("is not possible", f"at most {most:g}") if value > most else ("allows nothing", "more than 0")
        raise UsageError(f"a {what} of {text} {wrong}", where=where, remedy=f"{allowed}: {remedy}")
    return value, text.endswith("%")


def dead_band(text: str | None, where: str = "--dead-band") -> float | None:
    """Read a dead band in spans of the output, None for none. Raises UsageError for one above half of the span.

    >>> dead_band("0.03"), dead_band("3 %")
    (0.03, 0.03)"""
    return None if text is None else size(text, where, "size", "0.03 or 3% is 3 % of the output span", 0.5)[0]


def place(text: str) -> Path | Remote:
    """Read a path, or an address such as s3://bucket/plant.parquet."""
    from ..places import place

    return place(text)


def names(text: str) -> tuple[str, ...]:
    """Split names at commas."""
    return tuple(name.strip() for name in text.split(",")) if text else ()


PAGE = tomllib.loads((resources.files(__package__) / "commands.toml").read_text(encoding="utf-8"))
WRITTEN = ("output", "json_file", "html", "picture", "save_model", "plot", "history", "out", "truth", "target")
READ = {"loops": "the file of loop settings", "model_file": "the model", "db": "the history", "limits": "the limits"}
REPORT = b'"loop","verdict",'  # begins the table of a scan: that of the night before may lie among the exports
TYPES = {"path": click.Path(path_type=Path), "place": place, "names": names, "int": int,
         "result": lambda path: None if path == "-" else Path(path)}  # -: standard output, as without it


class Finite(click.FloatRange):
    """A number in a range, and no nan."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        found = super().convert(value, param, ctx)
        return found if math.isfinite(found) else self.fail(f"{value!r} is not a finite number.", param, ctx)


def function_of(name: str) -> Callable[..., int | None]:
    """Load what a command does: the function of its name, in the module of this folder that its page names."""
    return getattr(import_module(f".{PAGE[name]['module']}", __package__), name)


def command(name: str) -> click.Command:
    """Make a command, which never writes over what it reads; its words and options: `commands.toml`."""

    def run(**given: Any) -> int | None:
        if "loops" in given:
            given["loops"], *more = given["loops"] or [None]
            if more:  # it would be passed over
                raise refusal(UsageError, "loops_twice", "--loops")
        results = [path for path in map(given.get, WRITTEN) if isinstance(path, Path)]
        if twice := next((b for i, b in enumerate(results) if b.resolve() in map(Path.resolve, results[:i])), None):
            raise UsageError("this file is named for two things", where=f"{twice}", remedy="choose another for one")
        there = list[Path]()
        for path in results:
            from ..reporter.files import told
            with told(path):  # as writing would say after the work
                os.stat(f"{path.parent}/." if path.suffix else ".")
                there += [path] * path.is_file()
        if there:
            from ..loaders.sources import find_sidecars, find_sources

            inputs = given.get("inputs", ())
            sources = find_sources(inputs) if inputs else []
            read = [*((source.path, "the export itself") for source in sources),
                    *((path, READ["loops"]) for path in find_sidecars(inputs, sources)),
                    *((one, READ.get(key, "a file")) for key, one in given.items()
                      if key not in WRITTEN and one != given.get("save_model"))]
            for path, what in ((path, what) for path in there for one, what in read if
                               isinstance(one, Path) and one.is_file() and path.samefile(one)):
                with path.open("rb") as file:
                    if file.read(len(REPORT)) != REPORT:
                        raise refusal(UsageError, "written_over", path, what=what)
        if (page := given.get("html")) and page.suffix not in ("", ".html", ".htm"):  # no page over an export
            raise UsageError("a page ends in .html", where=f"--html {page}", remedy="end its name with .html")
        return function_of(name)(**given)

    words = PAGE[name]
    own = words.get("options", {})
    also = [one for entry in words.get("also", ()) for one in PAGE["groups"].get(entry, [entry]) if one not in own]
    epilog = "\n  ".join([words.get("epilog", "") + "\b\nExamples:", *words["examples"]])
    return click.Command(name, callback=run, help=words["help"], short_help=words["summary"], epilog=epilog,
                         params=[_parameter(one, own.get(one, {})) for one in [*own, *also]])


def _parameter(name: str, own: Mapping[str, Any]) -> click.Parameter:
    words = {**PAGE["options"].get(name, {}), **own}
    flags = words.pop("flags", "--" + name.replace("_", "-")).split()
    kind = TYPES.get(words.pop("type", ""))
    if "choices" in words:
        kind = click.Choice(words.pop("choices"))
    elif ends := words.pop("range", None):
        kind = (click.IntRange if isinstance(ends[0], int) else Finite)(*ends)
    if "help" not in words:
        return click.Argument([name], type=kind, **words)
    switch = (kind is None and "metavar" not in words) or None  # False would take a negative number for an option
    return click.Option([*flags, name], type=kind, is_flag=switch, **words)
