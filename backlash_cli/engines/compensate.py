"""The study of a compensator on a worker of a cluster, which reads the loop where the data are."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from ..compensate import compensate
from ..errors import BacklashError, LoopError
from ..loaders.choose import nothing_since
from ..loaders.parts import Part
from ..loaders.plant import find_loop, read
from ..record import Note
from ..results.compensation import CompensationStudy

if TYPE_CHECKING:
    from ..simulator.process import Process
    from .plant import DaskPlant


Answer = tuple[CompensationStudy | None, BacklashError | None]


def compensate_part(part: Part, process: Process | None = None, dead_band: float | None = None) -> Answer:
    """Read one loop and study its compensator in this process: the study, or what went wrong."""
    try:
        plant = read(part.sources, loops=part.metadata, options=part.reading)
        return compensate(plant[part.loops[0]], process=process, dead_band=dead_band), None
    except BacklashError as error:
        return None, error


def compensate_on_cluster(
    plant: DaskPlant, loop: str, *, process: Process | None = None, dead_band: float | None = None
) -> CompensationStudy:
    """Return the study of one loop, as `compensate` gives it. Raises BacklashError as reading it here would."""
    name = find_loop(loop, plant.plan.loops)
    work = partial(compensate_part, process=process, dead_band=dead_band)
    study, wrong = next(iter(plant.each(work, _lost, [name])))
    plan = plant.plan
    if wrong is not None and wrong.code == "nothing_since" and plan.reading.since and plan.moment is not None:
        raise nothing_since(plan.reading.since, plan.moment, plan.last)
    if wrong is not None:
        raise wrong
    assert study is not None
    return study


def _lost(loop: str, reason: Note) -> Answer:
    return None, LoopError(reason.message, where=loop, code=reason.code, remedy="see the logs of the workers")
