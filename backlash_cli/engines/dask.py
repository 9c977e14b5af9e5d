"""Parts of a plant on the workers of a Dask cluster: a worker that dies costs time, and at most the loop that kills it.

Dask itself gives the work of a dead worker to another one. Work whose workers die again and again is cut into single
loops, and each of these is tried once more with nothing beside it: what dies even so is named, the rest is complete.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, TypeVar
from uuid import uuid4

from ..errors import BacklashError
from ..loaders.parts import Part
from ..record import Note

if TYPE_CHECKING:
    from distributed import Client, Future

Result = TypeVar("Result")
ATTEMPTS = 3  # of work that was lost on its way


def on_cluster(
    client: Client, parts: Sequence[Part], work: Callable[[Part], Result], lost: Callable[[str, Note], Result]
) -> Iterator[Result]:
    """Yield the result of `work` for every part, as they come.

    work: a function that workers can import, and that answers for its own failures. lost: makes the result of a loop
    whose workers died. Raises BacklashError when the scheduler is gone. Closing the iterator stops the work.
    """
    from distributed import as_completed

    waiting: dict[Future, Part] = {}
    tried: dict[tuple[str, ...], int] = {}
    alone: list[Part] = []
    pool = as_completed([], raise_errors=False)

    def send(part: Part) -> None:
        future = client.submit(work, part, pure=False, key=f"backlash-{uuid4().hex}")
        waiting[future] = part
        pool.add(future)

    try:
        for part in parts:
            send(part)
        for future in pool:
            part = waiting.pop(future)
            outcome = _outcome(client, future)
            if not isinstance(outcome, Exception):
                yield outcome
            elif _gone(outcome) and tried.get(part.loops, 0) < ATTEMPTS:
                tried[part.loops] = tried.get(part.loops, 0) + 1
                send(part)
            elif len(part.loops) > 1:
                for loop in part.loops:
                    send(part.only([loop]))
            else:
                alone.append(part)
            del future
        for part in alone:
            future = client.submit(work, part, pure=False, key=f"backlash-{uuid4().hex}")
            outcome = _outcome(client, future)
            yield lost(part.loops[0], _reason(outcome)) if isinstance(outcome, Exception) else outcome
    finally:
        if waiting:
            client.cancel(list(waiting), force=True)


def _outcome(client: Client, future: Future) -> Any:
    """Return the result of a future, or the exception that took its place."""
    try:
        return future.result()
    except Exception as error:
        if client.status != "running":
            raise BacklashError("the connection to the scheduler was lost", where="--engine dask",
                                remedy="start the scan again",
                                code="no_scheduler") from None
        return error
    finally:
        future.release()


def _gone(error: Exception) -> bool:
    """Whether work was lost on its way, through no fault of its own."""
    return type(error).__name__ in ("CancelledError", "FutureCancelledError", "FuturesCancelledError")


def _reason(error: Exception) -> Note:
    if type(error).__name__ == "KilledWorker":
        return Note("process_died", "its worker was killed every time, perhaps for lack of memory")
    said = str(error).strip().split("\n")[0][:200]
    return Note("internal_error", f"its worker failed: {type(error).__name__}: {said}")

