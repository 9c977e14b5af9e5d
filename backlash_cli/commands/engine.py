"""Options on where the work is done: processes of this machine, or the workers of a Dask cluster."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, TypeVar

import click

from ..errors import UsageError
from .terminal import say

if TYPE_CHECKING:
    from distributed import Client

F = TypeVar("F", bound=Callable[..., Any])

_OPTIONS = (
    click.option("--engine", metavar="local|dask", type=click.Choice(["local", "dask"]), default="local",
                 help="Where the work is done: processes of this machine (default), or the workers of a Dask cluster; "
                 "without --scheduler a cluster of --jobs processes on this machine."),
    click.option("--scheduler", metavar="ADDRESS",
                 help="With --engine dask: the scheduler of a running cluster, such as tcp://host:8786."),
)


def engine_options(command: F) -> F:
    """Add --engine and --scheduler; the command receives them as `engine` and `scheduler`."""
    decorated: Any = command
    for option in reversed(_OPTIONS):
        decorated = option(decorated)
    return decorated


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
