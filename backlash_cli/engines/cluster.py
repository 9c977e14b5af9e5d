"""A Dask cluster to work on: one that runs already, or one of processes on this machine for the time of a scan.

A worker that dies costs time, and at most the item that kills it: Dask gives the work of a dead worker to another one.
"""

from __future__ import annotations

import contextlib
import logging
import os
import pickle
import threading
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, TypeVar

from .._version import __version__
from ..errors import BacklashError, UsageError
from ..record import Note
from ..words import explained, noted

if TYPE_CHECKING:
    from distributed import Client, Future

Result = TypeVar("Result")
Item = TypeVar("Item")
Say = Callable[[str], None]

ANSWER = 5.0  # seconds in which a scheduler has to answer
WORKERS = 60.0  # seconds in which an empty cluster has to get its first worker
PAUSE = 3.0  # seconds between two looks at the workers
MISSED = 5  # looks at which a worker may be missing: one that died is mostly there again after two
ATTEMPTS = 3  # of work that was lost on its way
_LOCAL = {
    # a loop that ends its process does so every time: two deaths are proof enough
    "distributed.scheduler.allowed-failures": 1, "distributed.scheduler.worker-saturation": 1.0,
    # a busy machine takes long to start a process again; given up, its work would wait for ever
    "distributed.deploy.lost-worker-timeout": "1 hour", "distributed.nanny.pre-spawn-environ.NUMBA_NUM_THREADS": 1}
_GONE = ("CancelledError", "FutureCancelledError", "FuturesCancelledError")  # lost through no fault of the work


@contextlib.contextmanager
def connected(scheduler: str | None, jobs: int | None = None, say: Say = lambda text: None, method: str = "spawn"
              ) -> Iterator[Client]:
    """Give a client of the cluster at `scheduler`, or of `jobs` processes on this machine that end with the block.

    say: is told what takes long. method: by which multiprocessing starts a process. Raises UsageError when Dask is not
    installed, BacklashError when no scheduler answers or its workers cannot do this work."""
    try:
        import dask
        from distributed import Client, LocalCluster
    except ImportError as error:
        raise UsageError(**explained("no_dask", problem=error), where="--engine dask") from None
    # Dask logs every death of a worker with its trace; what matters is said in our words
    for name in ("distributed", "tornado", "asyncio", "bokeh"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    with contextlib.ExitStack() as stack:
        cluster, wanted, where = None, 1, f"--scheduler {scheduler}"
        if scheduler is not None:
            try:
                for left in reversed(range(ATTEMPTS)):
                    # Dask trips over the work that another client cancels while it greets this one
                    with contextlib.suppress(*([AssertionError] if left else [])):
                        client = Client(scheduler, timeout=ANSWER, name="backlash")
                        break
            except ValueError as error:
                raise UsageError(**explained("no_address", problem=error), where=where) from None
            except Exception as error:
                raise BacklashError(**explained("no_scheduler", problem=_said(error)), where=where) from None
            stack.callback(client.close, timeout=5)
            _check_workers(client, scheduler, where, say)
        else:
            wanted = jobs or cores()
            stack.enter_context(dask.config.set({**_LOCAL, "distributed.worker.multiprocessing-method": method}))
            try:
                cluster = LocalCluster(n_workers=wanted, threads_per_worker=1, processes=True, dashboard_address=None,
                                       silence_logs=logging.CRITICAL)
            except Exception as error:
                raise BacklashError(**explained("no_cluster", problem=_said(error)), where="--engine dask") from error
            stack.callback(cluster.close)
            client = stack.enter_context(Client(cluster))
        ended = threading.Event()
        guard = threading.Thread(target=watch, args=(client, cluster, wanted, say, ended), daemon=True)
        guard.start()
        stack.callback(guard.join, 5)
        stack.callback(ended.set)
        yield client


def _check_workers(client: Client, scheduler: str, where: str, say: Say) -> None:
    """See that there are workers, and that they have the same backlash. Raises BacklashError when not."""
    if not client.scheduler_info(n_workers=-1)["workers"]:
        say(f"the scheduler at {scheduler} has no workers yet; waiting up to {WORKERS:g} s")
        nudge = client.submit(int, 0, pure=False)  # a cluster that adapts itself starts workers when there is work
        try:
            client.wait_for_workers(1, timeout=WORKERS)
        except TimeoutError:
            raise BacklashError(**explained("no_workers", scheduler=scheduler), where=where) from None
        nudge.release()
    found: dict[str, Any] = client.run(version_here, on_error="return")
    for worker, version in found.items():
        if isinstance(version, OSError):
            continue  # this one is just going
        if isinstance(version, BaseException):
            raise BacklashError(**explained("worker_fails", worker=worker, problem=_said(version), own=__version__),
                                where=where)
        if version != __version__:
            raise BacklashError(**explained("wrong_worker", worker=worker, its=version, own=__version__), where=where)


def cores() -> int:
    """Number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def version_here() -> str:
    """The version of backlash, as a worker sees it."""
    return __version__


def watch(client: Any, cluster: Any, wanted: int, say: Say, ended: threading.Event, pause: float = PAUSE) -> None:
    """See that there are workers until `ended`. A process of ours that dies while it starts may not be started again by
    Dask: then there is a new one. cluster: ours, None for others', whose workers can only be waited for."""
    missing, said = 0, False
    while not ended.wait(pause):
        try:
            alive = len(client.scheduler_info(n_workers=-1)["workers"])
            missing = missing + 1 if alive < wanted else 0
            if missing >= MISSED and cluster is not None:
                cluster.scale(wanted)
                missing = 0
            elif missing >= MISSED and not said:
                say("the scheduler has no workers any more; waiting for new ones")
            said = missing >= MISSED
        except Exception:  # the connection is lost, or about to be closed; those who wait for results are told
            continue


def threads(client: Client) -> int:
    """Number of loops that a cluster works on at once."""
    return max(1, sum(client.nthreads().values()))


def on_cluster(client: Client, items: Sequence[Item], work: Callable[[Item], Result],
               lost: Callable[[Item, Note], Result], count: int, pack: Callable[[Item], Item]) -> Iterator[Result]:
    """Yield the result of `work` for every item, in order.

    work: a function that workers can import, and that answers for its own failures. lost: makes the result of an item
    whose workers died. count: so many are worked on at once, and nearly as many wait. pack: makes of an item what can
    be sent to another machine. Raises what `work` raises of BacklashError, and one when the scheduler is gone."""
    waiting: list[Future] = []

    def send(item: Item) -> Future:
        return client.submit(_worked, work, pickle.dumps(pack(item)), pure=False)

    try:
        for position, item in enumerate(items):
            waiting += [send(coming) for coming in items[position + len(waiting) : position + 2 * count - 1]]
            for _ in range(ATTEMPTS):
                outcome = _outcome(client, waiting[0])
                if type(outcome).__name__ not in _GONE:
                    break
                waiting[0] = send(item)
            del waiting[0]
            if isinstance(outcome, BacklashError):
                raise outcome
            if isinstance(outcome, Exception):
                code = "process_died:worker" if type(outcome).__name__ == "KilledWorker" else "internal_error:worker"
                outcome = lost(item, noted(code, problem=_said(outcome)))
            yield outcome
    finally:
        if waiting:
            client.cancel(waiting, force=True)


def _worked(work: Callable[[Any], Result], item: bytes) -> Result:
    return work(pickle.loads(item))


def _outcome(client: Client, future: Future) -> Any:
    """Return the result of a future, or the exception that took its place."""
    try:
        return future.result()
    except Exception as error:
        if client.status != "running":
            raise BacklashError(**explained("lost_scheduler"), where="--engine dask") from None
        return error
    finally:
        future.release()


def _said(error: BaseException) -> str:
    return f"{type(error).__name__}: {str(error).strip().partition(chr(10))[0][:200]}"
