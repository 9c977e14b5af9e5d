"""Analyse the loops of a plant: one after the other, in several processes of this machine, or on a cluster.

The reports come in the order of the loops wherever the work is done, and a loop that fails, or takes its process down
with it, becomes a report with verdict `error`; the others go on."""

from __future__ import annotations

import gc
import multiprocessing
import os
import signal
import sys
import threading
import warnings
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from itertools import chain
from multiprocessing.context import BaseContext
from typing import TYPE_CHECKING, Any

from ..errors import BacklashError
from ..history.unfinished import Unfinished
from ..loaders.clean import Recipe
from ..loaders.signals import Axis, Joiner, Store
from ..record import Note, Record, failure
from ..results import LoopReport, Verdict
from ..scanning import ScanOptions, scan_blocks
from .cluster import Item, Result, cores, on_cluster, threads

if TYPE_CHECKING:
    from multiprocessing.synchronize import Event

    from distributed import Client

Loop = Record | Recipe
Found = LoopReport | Note

PER_TASK = 16  # loops that a process takes at once; they share their time stamps on the way
# CPU time on a machine of 2026, in seconds; a process that takes longer to start than it works is not worth it
START = 1.2  # of a process
COST = {False: (4e-3, 80e-9), True: (20e-3, 1e-6)}  # of a scan, without and with confirmation: per loop, per sample


def processes(loops: Sequence[Loop], wanted: int | None = None, *, confirm: bool = True) -> int:
    """Number of processes for `loops`: as wanted, else one for little work and at most one per core for much."""
    if wanted is not None:
        return max(1, min(wanted, len(loops)))
    per_loop, per_sample = COST[confirm]
    work = sum(per_loop + per_sample * (loop.rows if isinstance(loop, Recipe) else len(loop)) for loop in loops)
    return max(1, min(cores(), len(loops), int(work / START)))


def analyse(loops: Sequence[Loop], options: ScanOptions | None = None, *, jobs: int | None = None,
            keep: Unfinished | None = None, client: Client | None = None) -> Iterator[Found]:
    """Yield for every loop, in order, its report, or a note where it could not be read.

    loops: Records, or Recipes; these are read when their turn comes, in the process that analyses them, and forgotten
    afterwards. jobs: processes; None chooses. keep: takes in each report as soon as it is finished; loops that it knows
    are not read. client: of a cluster that does the work. Closing the iterator stops the work."""
    kept = [None if keep is None else keep.known.get(getattr(loop, "key", "")) for loop in loops]
    missing = [loop for loop, known in zip(loops, kept, strict=True) if known is None]
    fresh = _analysed(missing, options or ScanOptions(), jobs, keep, client)
    for known in kept:
        yield next(fresh) if known is None else known


def _analysed(loops: list[Loop], options: ScanOptions, jobs: int | None, keep: Unfinished | None,
              client: Client | None) -> Iterator[Found]:
    count = processes(loops, jobs, confirm=options.confirm) if client is None else threads(client)
    if count == 1 and client is None:
        yield from analyse_group(loops, options, keep)
        return
    work = partial(_listed, options=options, keep=keep if client is None else None)

    def lost(group: tuple[Loop, ...], reason: Note) -> list[Found]:
        """A process died over some loops: each is tried by itself, so that only the one to blame is lost."""
        if len(group) == 1:
            return [failed(group[0], reason)]
        return [one for found in _dealt([(loop,) for loop in group], work, lost, 1, client) for one in found]

    size = max(1, min(PER_TASK, len(loops) // (4 * count)))
    groups = [tuple(loops[i : i + size]) for i in range(0, len(loops), size)]
    for group, found in zip(groups, _dealt(groups, work, lost, count, client), strict=True):
        for loop, one in zip(group, found, strict=True):
            if keep is not None and client is not None:
                keep.add(getattr(loop, "key", ""), one)
            yield one


def _dealt(items: Sequence[Item], work: Callable[[Item], Result], lost: Callable[[Item, Note], Result], count: int,
           client: Client | None) -> Iterator[Result]:
    """Yield the result of `work` for every item, in order, worked out in `count` processes or on the cluster."""
    return in_processes(items, work, lost, count) if client is None else on_cluster(
        client, items, work, lost, count, _packed)


def _packed(item: Any) -> Any:
    """What is sent to another machine, which has no part in the scratch file of this one."""
    return [with_samples(one) if isinstance(one, Recipe) else one for one in item] if isinstance(item, tuple) else item


def with_samples(recipe: Recipe) -> Recipe:
    """Return it with what lies in the scratch file in memory; columns of Parquet files are read where the work is."""
    columns = defaultdict[Axis, set[str]](set)
    for item in chain.from_iterable((*recipe.series.roles.values(), *recipe.series.extra.values())):
        columns[item.axis] |= {f"v{i}" for i in (item.column, *item.marks)}

    def taken(axis: Axis) -> Axis:
        if not isinstance(axis.rows, Store):
            return axis
        piece: dict[str, Any] = {axis.column: axis.read()}
        store = Store.in_memory()
        store.lexicons = axis.rows.lexicons
        for column in columns[axis]:
            cells = axis.cells(column)
            piece |= {column: cells.values} | ({} if cells.codes is None else {f"{column}w": cells.codes})
        store.add(piece)
        return replace(axis, rows=store, which=range(len(axis)), group=0)

    return replace(recipe, series=recipe.series.changed(taken))


def _listed(group: Sequence[Loop], options: ScanOptions, keep: Unfinished | None) -> list[Found]:
    return list(analyse_group(group, options, keep))


def analyse_group(group: Sequence[Loop], options: ScanOptions, keep: Unfinished | None = None) -> Iterator[Found]:
    """Read and analyse some loops, one after the other; a note says why one could not be read."""
    joiner = next((Joiner(loop.options.good_quality) for loop in group if isinstance(loop, Recipe)), None)
    for loop in group:
        try:
            blocks = iter([loop]) if isinstance(loop, Record) else loop.chunks() if loop.is_long() else iter(
                [loop.record(joiner)])
            first = next(blocks)
        except BacklashError as error:
            yield failure(error, loop=loop.loop)
            continue
        except Exception as error:  # one loop's failure must not cost the others their report
            yield failed(loop, Note("internal_error", f"reading failed: {type(error).__name__}: {error}"))
            continue
        report = analyse_loop(first, options, blocks)
        if keep is not None:
            keep.add(getattr(loop, "key", ""), report)
        yield report


def analyse_loop(first: Record, options: ScanOptions, others: Iterator[Record]) -> LoopReport:
    """Return the report of one loop from its first block and the others; whatever goes wrong in it is its reason."""
    return _guarded(lambda: scan_blocks(chain([first], others), options), partial(failed, first), "the analysis failed")


def _guarded(work: Callable[[], Result], lost: Callable[[Note], Item], words: str) -> Result | Item:
    """Return what `work` does, or what `lost` makes of the reason why not: one failure must not cost the others."""
    try:
        return work()
    except BacklashError as error:
        return lost(Note(error.code, str(error)))
    except Exception as error:
        return lost(Note("internal_error", f"{words}: {type(error).__name__}: {error}"))


def failed(loop: Loop, reason: Note) -> LoopReport:
    """The report of a loop that could not be analysed."""
    if isinstance(loop, Recipe):
        return LoopReport(loop.loop, Verdict.ERROR, (reason,), warnings=loop.notes)
    first, last = (loop.time[[0, -1]].tolist()) if len(loop) else (None, None)
    return LoopReport(loop.loop, Verdict.ERROR, (reason,), start=first, end=last, samples=len(loop),
                      interval_s=loop.interval, settings=loop.settings, warnings=loop.notes)


def answers(records: Sequence[Record], work: Callable[[Record], Result], *, jobs: int | None = None,
            client: Client | None = None) -> Iterator[Result | Note]:
    """Yield for every record, in order, what `work` makes of it, or a note that names the loop and says why not.

    work: can be pickled. jobs: processes; None is one per core, 1 stays in this process. client: of a cluster that
    does the work. Closing the iterator stops the work."""
    guarded = partial(_answer, work=work)
    count = threads(client) if client else max(1, min(len(records), cores() if jobs is None else jobs))
    return _dealt(records, guarded, _no_answer, count, client) if count > 1 or client else map(guarded, records)


def _answer(record: Record, work: Callable[[Record], Result]) -> Result | Note:
    return _guarded(lambda: work(record), partial(_no_answer, record), "failed")


def _no_answer(record: Record, reason: Note) -> Note:
    said = reason.message if reason.message.startswith(record.loop) else f"{record.loop}: {reason.message}"
    return Note(reason.code, said, {**reason.values, "loop": record.loop})


def context_of_processes(*, compiled: bool = True) -> BaseContext:
    """Begin, where it does not run yet, the process that has loaded what a scan needs and of which all others are
    forked: not of this one, whose threads a fork would copy in an unknown state. Where that cannot be (Windows; no
    folder for its socket) every process is begun anew. compiled: with its compiled loops, for PV against OP."""
    # it looks for modules where this process does, not in the folder one works in; an empty value is as none
    given = {"PYTHONSAFEPATH": "1", "PYTHONPATH": os.pathsep.join(map(os.path.abspath, sys.path)),
             "PYTHONWARNINGS": "ignore"}  # after a stop, of locks that are cleared away
    before = {name: os.environ.get(name, "") for name in given}
    os.environ.update(given)
    try:
        from multiprocessing import resource_tracker
        from multiprocessing.forkserver import ensure_running

        resource_tracker.ensure_running()  # its start lets Ctrl-C through again, to what is begun next as well
        context = multiprocessing.get_context("forkserver")
        context.set_forkserver_preload([__name__, *["backlash_cli.kernels"] * compiled, "scipy.signal"])
        with _stops_wait():
            ensure_running()
        return context
    except (ImportError, OSError, ValueError):
        return multiprocessing.get_context("spawn")
    finally:
        os.environ.update(before)


def in_processes(items: Sequence[Item], work: Callable[[Item], Result], lost: Callable[[Item, Note], Result], count: int
                 ) -> Iterator[Result]:
    """Yield the result of `work` for every item, in order, worked out in `count` processes.

    work: can be pickled, and answers for its own failures. lost: makes the result of an item whose process died. Raises
    BacklashError where no process starts."""
    context = context_of_processes()
    others, started = set(multiprocessing.active_children()), context.Event()
    pool = ProcessPoolExecutor(count, mp_context=context, initializer=_begin, initargs=(started,))
    try:
        waiting: list[Future[Result]] = []
        ahead = 2 * count  # items on their way to the processes; more would only fill memory
        for position, item in enumerate(items):
            try:
                with _stops_wait():  # may start a process, which complains where it is left half told what to do
                    waiting += [pool.submit(work, one) for one in items[position + len(waiting) : position + ahead]]
                result = waiting.pop(0).result()
            except (BrokenProcessPool, OSError):  # a process died over an item nobody knows, or while another began
                if count == 1 and not started.is_set():  # each process runs the script of the first one anew
                    raise BacklashError("no further process could be started", remedy=(
                        "ask for one job (jobs=1); a script asks for more below if __name__ == '__main__':")) from None
                pool.shutdown(wait=False)
                pool = ProcessPoolExecutor(count, mp_context=context, initializer=_begin, initargs=(started,))
                waiting.clear()
                if count > 1:
                    (result,) = in_processes([item], work, lost, 1)
                else:
                    result = lost(item, Note("process_died", "its process was killed, perhaps for lack of memory"))
            yield result
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
        ours = set(multiprocessing.active_children()) - others
        for child in ours:
            child.terminate()
        for child in ours:
            child.join(5)


@contextmanager
def _stops_wait() -> Iterator[None]:
    """Hold back what stops this process, and let processes begun meanwhile be deaf to Ctrl-C from the first."""
    if threading.current_thread() is not threading.main_thread() or not hasattr(signal, "pthread_sigmask"):
        yield  # Python answers signals in the main thread alone
        return
    came: list[int] = []
    usual = {number: signal.signal(number, lambda number, frame: came.append(number))
             for number in (signal.SIGINT, signal.SIGTERM) if callable(signal.getsignal(number))}
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        for number, answer in usual.items():
            signal.signal(number, answer)
        for late in came:
            signal.raise_signal(late)


def _begin(started: Event) -> None:
    started.set()
    gc.freeze()  # what was loaded before is no garbage
    warnings.simplefilter("ignore")  # as in the first process: remarks of libraries to programmers
    # Ctrl-C reaches every process of the terminal; only the first one answers it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_the_first, daemon=True).start()


def _end_with_the_first() -> None:
    """A first process that was killed could not end the others: they would wait for work for ever."""
    if (first := multiprocessing.parent_process()) is not None:
        first.join()
        os._exit(1)
