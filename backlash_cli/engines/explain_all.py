"""Explain every loop of a plant, in several processes or on a cluster; a loop that fails is named, the others go on."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

from ..errors import BacklashError
from ..loaders.parts import Part
from ..loaders.plant import Plant, read
from ..record import Note, Record
from ..results import Explanation
from .local import cores, in_processes

if TYPE_CHECKING:
    from .plant import DaskPlant

MOST_LOOPS = 4  # of a part: a loop takes seconds


def explain_all(
    records: Sequence[Record], effects: Sequence[str] = (), *, jobs: int | None = None
) -> Iterator[Explanation | Note]:
    """Yield for every record, in order, its explanation, or a note that says why there is none.

    effects: references (`module:NAME`) of further effects to try. jobs: processes; None is one per core, 1 stays in
    this process. Closing the iterator stops the work.
    """
    work = partial(explain_loop, effects=tuple(effects))
    count = max(1, min(len(records), cores() if jobs is None else jobs))
    if count == 1:
        return (work(record) for record in records)
    return in_processes(records, work, _died, count)


def explain_loop(record: Record, effects: tuple[str, ...] = ()) -> Explanation | Note:
    """Return the explanation of one loop; whatever goes wrong becomes the note's message."""
    from ..model import explain

    try:
        return explain(record, effects=effects)
    except BacklashError as error:
        where = "" if error.where.startswith(record.loop) else f"{record.loop}: "
        return Note(error.code, f"{where}{error}", {"loop": record.loop})
    except Exception as error:  # one loop's failure must not cost the others their answer
        return unexplained(record.loop, Note("internal_error", f"failed: {type(error).__name__}: {error}"))


def unexplained(loop: str, reason: Note) -> Note:
    """The note of a loop that has no explanation."""
    return Note(reason.code, f"{loop}: {reason.message}", {**reason.values, "loop": loop})


def _died(record: Record, reason: Note) -> Note:
    return unexplained(record.loop, reason)


@dataclass
class Explaining:
    """A plant whose loops are being explained. names: of all loops.

    found: yields for every loop that can be read its explanation, or a note why there is none; on a cluster as they
    come. When it has ended, warnings and failures are what was said of files, and of loops that cannot be read.
    """

    names: tuple[str, ...]
    found: Iterator[Explanation | Note]
    inputs: tuple[str, ...]
    warnings: tuple[Note, ...] = ()
    failures: tuple[Note, ...] = ()


def explaining_here(plant: Plant, effects: tuple[str, ...], *, jobs: int | None) -> Explaining:
    """Explain a plant in processes of this machine."""
    failed = [str(note.values["loop"]) for note in plant.failures if "loop" in note.values]
    names = tuple(sorted({*(record.loop for record in plant), *failed}))
    found = explain_all(plant.records, effects, jobs=jobs)
    return Explaining(names, found, plant.inputs, plant.warnings, plant.failures)


@dataclass(frozen=True)
class ExplainedPart:
    """What a worker found: an explanation or a note per loop, and what it could not read."""

    found: tuple[Explanation | Note, ...]
    warnings: tuple[Note, ...] = ()
    failures: tuple[Note, ...] = ()


def explain_part(part: Part, effects: tuple[str, ...] = (), light: bool = False) -> ExplainedPart:
    """Read and explain one part of a plant in this process. light: without the series, which are large."""
    plant = read(part.sources, loops=part.metadata, options=part.reading)
    found = [explain_loop(record, effects) for record in plant]
    if light:
        found = [one if isinstance(one, Note) else one.light() for one in found]
    return ExplainedPart(tuple(found), plant.warnings, plant.failures)


def explaining_on_cluster(plant: DaskPlant, effects: tuple[str, ...], *, light: bool) -> Explaining:
    """Explain a plant on a cluster; light: without the series. Raises BacklashError, at the end, when nothing could be
    read."""
    explaining = Explaining(tuple(sorted(plant.plan.loops)), iter(()), plant.plan.given)
    explaining.found = _on_cluster(plant, partial(explain_part, effects=effects, light=light), explaining)
    return explaining


def _on_cluster(plant: DaskPlant, work: partial[ExplainedPart], explaining: Explaining) -> Iterator[Explanation | Note]:
    done: list[str] = []
    warnings: list[Note] = []
    failures: list[Note] = []
    for part in plant.each(work, _lost, most=MOST_LOOPS):
        for one in part.found:
            done.append(str(one.values["loop"]) if isinstance(one, Note) else one.loop)
            yield one
        warnings += part.warnings
        failures += part.failures
    whole = plant.whole(done, warnings, failures)
    explaining.warnings = whole.warnings
    explaining.failures = (*whole.failures, *(whole.refused[name] for name in sorted(whole.refused)))


def _lost(loop: str, reason: Note) -> ExplainedPart:
    return ExplainedPart((unexplained(loop, reason),))
