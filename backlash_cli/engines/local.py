"""Analyse the loops of a plant on this machine: one after the other, or in several processes.

The reports come in the order of the records whatever the number of processes, and a loop that fails, or takes its
process down with it, becomes a report with verdict `error`; the others go on.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from functools import partial
from itertools import chain
from typing import TypeVar

from ..errors import BacklashError
from ..history.unfinished import Unfinished
from ..loaders.clean import Recipe
from ..loaders.join import Joiner
from ..loaders.plant import failure
from ..record import LoopSettings, Note, Record
from ..results import LoopReport, Verdict
from ..scanning import ScanOptions, pieces, scan, scan_blocks

Result = TypeVar("Result")
Item = TypeVar("Item")

PER_TASK = 16  # loops that a process takes at once; they share their time stamps on the way
# CPU time on a machine of 2026, in seconds; a process that takes longer to start than it works is not worth it
START = 0.8  # of a process
PER_SAMPLE, PER_SAMPLE_CONFIRMED, PER_LOOP = 40e-9, 2e-6, 0.5e-3  # of a scan


def processes(loops: Sequence[Record | Recipe], wanted: int | None = None, *, confirm: bool = True) -> int:
    """Number of processes for `loops`: as wanted, else one for little work and at most one per core for much."""
    if wanted is not None:
        return max(1, min(wanted, len(loops)))
    samples = sum(loop.rows if isinstance(loop, Recipe) else len(loop) for loop in loops)
    work = samples * (PER_SAMPLE_CONFIRMED if confirm else PER_SAMPLE) + len(loops) * PER_LOOP
    return max(1, min(cores(), len(loops), int(work / START)))


def cores() -> int:
    """Number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def analyse(
    records: Sequence[Record], options: ScanOptions | None = None, *, jobs: int | None = None
) -> Iterator[LoopReport]:
    """Yield one report per record, in order; `jobs` processes, None chooses. Closing the iterator stops the work."""
    options = options or ScanOptions()
    count = processes(records, jobs, confirm=options.confirm)
    if count == 1:
        return (analyse_loop(record, options) for record in records)
    return in_processes(records, partial(analyse_loop, options=options), failed, count)


def analyse_loop(record: Record, options: ScanOptions) -> LoopReport:
    """Return the report of one loop; whatever goes wrong in it becomes its reason."""
    return _analyse(lambda: scan(record, options), record)


def _analyse(work: Callable[[], LoopReport], record: Record) -> LoopReport:
    try:
        return work()
    except BacklashError as error:
        return failed(record, Note(error.code, str(error)))
    except Exception as error:  # one loop's failure must not cost the others their report
        return failed(record, Note("internal_error", f"the analysis failed: {type(error).__name__}: {error}"))


def analyse_recipes(
    recipes: list[Recipe], options: ScanOptions | None = None, *, jobs: int | None = None,
    keep: Unfinished | None = None,
) -> Iterator[LoopReport | Note]:
    """Yield for every recipe, in order, the report of its loop, or a note where it could not be read.

    Each loop is read when its turn comes, in the process that analyses it, and forgotten afterwards; `recipes` is
    emptied on the way. keep: takes in each report as soon as it is finished; loops that it knows are not read.
    """
    options = options or ScanOptions()
    if keep is not None and any(recipe.key in keep.known for recipe in recipes):
        return _going_on(recipes, options, jobs, keep)
    count = processes(recipes, jobs, confirm=options.confirm)
    if count == 1:
        return _in_turn(recipes, options, keep)
    size = max(1, min(PER_TASK, len(recipes) // (4 * count)))
    groups = [tuple(recipes[i : i + size]) for i in range(0, len(recipes), size)]
    recipes.clear()
    work = partial(analyse_group, options=options, keep=keep)
    return (one for group in in_processes(groups, work, partial(_one_by_one, work=work), count) for one in group)


def _going_on(
    recipes: list[Recipe], options: ScanOptions, jobs: int | None, keep: Unfinished
) -> Iterator[LoopReport | Note]:
    """The loops that are not known are analysed, and the others put in between, in order."""
    kept = [keep.known.get(recipe.key) for recipe in recipes]
    missing = [recipe for recipe, known in zip(recipes, kept, strict=True) if known is None]
    recipes.clear()
    if not missing:
        yield from (known.report for known in kept if known is not None)
        return
    fresh = analyse_recipes(missing, options, jobs=jobs, keep=keep)
    for known in kept:
        yield next(fresh) if known is None else known.report


def _in_turn(
    recipes: list[Recipe], options: ScanOptions, keep: Unfinished | None
) -> Iterator[LoopReport | Note]:
    joiner = Joiner(recipes[0].options.good_quality) if recipes else None
    recipes.reverse()
    while recipes:
        yield analyse_recipe(recipes.pop(), options, joiner, keep)


def analyse_recipe(
    recipe: Recipe, options: ScanOptions, joiner: Joiner | None = None, keep: Unfinished | None = None
) -> LoopReport | Note:
    """Read and analyse one loop; a note says why it could not be read."""
    try:
        long = recipe.is_long()
        record = next(recipe.chunks()) if long else recipe.record(joiner)
    except BacklashError as error:
        return failure(error, loop=recipe.loop)
    except Exception as error:  # one loop's failure must not cost the others their report
        return _lost(recipe, Note("internal_error", f"reading failed: {type(error).__name__}: {error}"))
    if long:
        blocks = partial(_blocks, recipe)
        report = _analyse(lambda: scan_blocks(blocks, options), record)
    else:
        report = analyse_loop(record, options)
    if keep is not None:
        keep.add(recipe.key, report)
    return report


def _blocks(recipe: Recipe) -> Iterator[Record]:
    return chain.from_iterable(map(pieces, recipe.chunks()))


def analyse_group(
    group: Sequence[Recipe], options: ScanOptions, keep: Unfinished | None = None
) -> list[LoopReport | Note]:
    """Read and analyse some loops, one after the other."""
    joiner = Joiner(group[0].options.good_quality)
    return [analyse_recipe(recipe, options, joiner, keep) for recipe in group]


def _one_by_one(
    group: Sequence[Recipe], reason: Note, work: Callable[[Sequence[Recipe]], list[LoopReport | Note]]
) -> list[LoopReport | Note]:
    """A process died over some loops: give each a process of its own, so that only the one to blame is lost."""
    if len(group) == 1:
        return [_lost(group[0], reason)]
    alone = [(recipe,) for recipe in group]
    return [one for found in in_processes(alone, work, partial(_one_by_one, work=work), 1) for one in found]


def _lost(recipe: Recipe, reason: Note) -> LoopReport:
    settings = LoopSettings(source={})  # can travel between processes
    return LoopReport(recipe.loop, Verdict.ERROR, (reason,), settings=settings, warnings=recipe.notes)


def failed(record: Record, reason: Note) -> LoopReport:
    """The report of a loop that could not be analysed."""
    first, last = (record.time[[0, -1]].tolist()) if len(record) else (None, None)
    return LoopReport(
        record.loop, Verdict.ERROR, (reason,), start=first, end=last, samples=len(record),
        interval_s=record.interval, settings=record.settings, warnings=record.notes,
    )


def in_processes(
    records: Sequence[Item], work: Callable[[Item], Result], lost: Callable[[Item, Note], Result], count: int
) -> Iterator[Result]:
    """Yield the result of `work` for every record, in order, worked out in `count` processes.

    work: can be pickled, and answers for its own failures. lost: makes the result of a loop whose process died.
    """
    # spawn: a fork would copy the threads of numba and pyarrow in an unknown state
    context = multiprocessing.get_context("spawn")
    others = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(count, mp_context=context, initializer=_begin)
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
                pool = ProcessPoolExecutor(count, mp_context=context, initializer=_begin)
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
    record: Item, work: Callable[[Item], Result], lost: Callable[[Item, Note], Result],
    context: multiprocessing.context.SpawnContext,
) -> Result:
    with ProcessPoolExecutor(1, mp_context=context, initializer=_begin) as pool:
        try:
            return pool.submit(work, _portable(record)).result()
        except BrokenProcessPool:
            return lost(record, Note("process_died", "its process was killed, perhaps for lack of memory"))


def _portable(record: Item) -> Item:
    """A record with its read-only mappings as plain ones, which can travel between processes; the rest can."""
    if not isinstance(record, Record):
        return record
    return replace(record, settings=replace(record.settings, source=dict(record.settings.source)))


def _begin() -> None:
    # Ctrl-C reaches every process of the terminal; only the first one answers it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_the_first, daemon=True).start()


def _end_with_the_first() -> None:
    """A first process that was killed could not end the others: they would wait for work for ever."""
    first = multiprocessing.parent_process()
    if first is not None:
        first.join()
        os._exit(1)
