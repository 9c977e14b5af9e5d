"""Analyse the loops of a plant on this machine: one after the other, or in several processes.

The reports come in the order of the records whatever the number of processes, and a loop that fails, or takes its
process down with it, becomes a report with verdict `error`; the others go on.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from functools import partial
from typing import TypeVar

from ..errors import BacklashError
from ..record import Note, Record
from ..results import LoopReport, Verdict
from ..scan import ScanOptions, scan

Result = TypeVar("Result")

SAMPLES_PER_PROCESS = 2_000_000  # starting a process takes as long as scanning about this many samples


def processes(records: Sequence[Record], wanted: int | None = None) -> int:
    """Number of processes for `records`: as wanted, else one for small inputs and at most one per core for large."""
    if wanted is not None:
        return max(1, min(wanted, len(records)))
    return max(1, min(cores(), len(records), sum(map(len, records)) // SAMPLES_PER_PROCESS))


def cores() -> int:
    """Number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def analyse(
    records: Sequence[Record], options: ScanOptions | None = None, *, jobs: int | None = None
) -> Iterator[LoopReport]:
    """Yield one report per record, in order; `jobs` processes, None chooses. Closing the iterator stops the work."""
    options = options or ScanOptions()
    count = processes(records, jobs)
    if count == 1:
        return (analyse_loop(record, options) for record in records)
    return in_processes(records, partial(analyse_loop, options=options), failed, count)


def analyse_loop(record: Record, options: ScanOptions) -> LoopReport:
    """Return the report of one loop; whatever goes wrong in it becomes its reason."""
    try:
        return scan(record, options)
    except BacklashError as error:
        return failed(record, Note(error.code, str(error)))
    except Exception as error:  # one loop's failure must not cost the others their report
        return failed(record, Note("internal_error", f"the analysis failed: {type(error).__name__}: {error}"))


def failed(record: Record, reason: Note) -> LoopReport:
    """The report of a loop that could not be analysed."""
    first, last = (record.time[[0, -1]].tolist()) if len(record) else (None, None)
    return LoopReport(
        record.loop, Verdict.ERROR, (reason,), start=first, end=last, samples=len(record),
        interval_s=record.interval, settings=record.settings, warnings=record.notes,
    )


def in_processes(
    records: Sequence[Record], work: Callable[[Record], Result], lost: Callable[[Record, Note], Result], count: int
) -> Iterator[Result]:
    """Yield the result of `work` for every record, in order, worked out in `count` processes.

    work: can be pickled, and answers for its own failures. lost: makes the result of a loop whose process died.
    """
    # spawn: a fork would copy the threads of numba and pyarrow in an unknown state
    context = multiprocessing.get_context("spawn")
    others = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(count, mp_context=context, initializer=_ignore_interrupt)
    try:
        waiting: list[Future[Result]] = []
        ahead = 2 * count  # records on their way to the processes; more would only fill memory
        for position, record in enumerate(records):
            try:
                for coming in records[position + len(waiting) : position + ahead]:
                    waiting.append(pool.submit(work, _portable(coming)))
                report = waiting.pop(0).result()
            except BrokenProcessPool:
                # A process died (killed, out of memory). Nobody knows whose loop it was: try this one alone.
                report = _alone(record, work, lost, context)
                pool.shutdown(wait=False)
                pool = ProcessPoolExecutor(count, mp_context=context, initializer=_ignore_interrupt)
                waiting.clear()
            yield report
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
        ours = set(multiprocessing.active_children()) - others
        for child in ours:
            child.terminate()
        for child in ours:
            child.join(5)


def _alone(
    record: Record, work: Callable[[Record], Result], lost: Callable[[Record, Note], Result],
    context: multiprocessing.context.SpawnContext,
) -> Result:
    with ProcessPoolExecutor(1, mp_context=context, initializer=_ignore_interrupt) as pool:
        try:
            return pool.submit(work, _portable(record)).result()
        except BrokenProcessPool:
            return lost(record, Note("process_died", "its process was killed, perhaps for lack of memory"))


def _portable(record: Record) -> Record:
    """The record with its read-only mappings as plain ones, which can travel between processes."""
    return replace(record, settings=replace(record.settings, source=dict(record.settings.source)))


def _ignore_interrupt() -> None:
    # Ctrl-C reaches every process of the terminal; only the first one answers it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
