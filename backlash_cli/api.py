"""The public functions over whole plants: read exports, scan their loops, compare and explain single loops."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .errors import MetadataError, UsageError, some
from .record import Note, Record
from .results import LoopReport, Model, ScanResult, Verdict
from .toml_text import read_page
from .words import explained, noted

if TYPE_CHECKING:
    from distributed import Client

    from .history.unfinished import Unfinished
    from .loaders import Plant, ReadOptions
    from .loaders.plant import OpenPlant
    from .scanning import ScanOptions
    from .settings import Metadata


def scan(plant: Plant | OpenPlant | Record | Iterable[Record], options: ScanOptions | None = None, *,
         jobs: int | None = 1, progress: Callable[[LoopReport], None] | None = None, keep: Unfinished | None = None,
         client: Client | None = None) -> ScanResult:
    """Analyse every loop and return one report per loop, in the order of the plant.

    plant: what `read` returns, one Record, or several. jobs: number of processes, None for one per core; a script that
    asks for more than this one does so below `if __name__ == "__main__":`. progress: called after each loop. keep: of
    an OpenPlant whose recipes are keyed, what was finished before a scan was stopped. client: of a Dask cluster that
    does the work. A loop that cannot be analysed is reported with verdict `error`."""
    from .engines.local import analyse  # what a scan needs takes a second to load, which models of a loop do without
    from .loaders.clean import Recipe
    from .loaders.plant import OpenPlant

    warnings, failures, inputs = (getattr(plant, name, ()) for name in ("warnings", "failures", "inputs"))
    loops: Any = plant.recipes if isinstance(plant, OpenPlant) else plant
    loops = tuple(loops) if isinstance(loops, Iterable) else (loops,)
    if not all(isinstance(loop, (Record, Recipe)) for loop in loops):
        raise UsageError(**explained("no_plant", given=type(plant).__name__))
    reports, lost = [], []
    for report in analyse(loops, options, jobs=jobs, keep=keep, client=client):
        if isinstance(report, Note):
            lost.append(report)
        else:
            reports.append(report)
        if progress is not None:
            progress(_refused(report) if isinstance(report, Note) else report)
    if isinstance(plant, OpenPlant):
        failures += plant.all_lost(lost, read=len(reports))
    alike = defaultdict[object, list[str]](list)
    for one in reports:
        if one.cluster and (one.cluster.n or one.confirmation):
            alike[one.start, one.samples, one.cluster, one.confirmation and one.confirmation.delta_bic].append(one.loop)
    warnings += tuple(noted("copied_loops", names=some(names)) for names in alike.values() if len(names) > 1)
    known = {report.loop for report in reports}
    own = [note for note in failures if note.values.get("loop") and note.values["loop"] not in known]
    others = tuple(note for note in failures if note not in own)
    return ScanResult((*reports, *map(_refused, own)), inputs, warnings, others)


def scan_files(inputs: str | PathLike[str] | Sequence[str | PathLike[str]], *, jobs: int | None = 1,
               loops: str | PathLike[str] | Metadata | None = None, reading: ReadOptions | None = None,
               options: ScanOptions | None = None, progress: Callable[[LoopReport], None] | None = None,
               taken: Callable[[int], None] | None = None) -> ScanResult:
    """Read exports and analyse their loops in one go, in bounded memory; the same result as `scan(read(...))`.

    inputs, loops, reading: as for `read`; `reading.only_loops` names the loops wanted. options, jobs, progress: as for
    `scan`. taken: called with the bytes of a file that were taken in. The samples are not kept: use `read` for them.
    Raises BacklashError when nothing can be read."""
    from .loaders.plant import open_plant

    return scan(open_plant(inputs, loops=loops, options=reading, taken=taken), options, jobs=jobs, progress=progress)


def load_model(path: str | PathLike[str]) -> Model:
    """Read a model file (TOML), as `explain --save-model` writes it or as written by hand. Raises MetadataError."""
    from .model.saved_model import parse_model

    page = read_page(path, "the model file", "backlash explain ... --save-model FILE writes one")
    return parse_model(page, str(path))


def save_model(model: Model, path: str | PathLike[str]) -> None:
    """Write a model as a TOML file, whole or not at all; a model that is there is replaced, any other file is not."""
    from .model.saved_model import model_text
    from .reporter.files import write_text

    if Path(path).is_file() and Path(path).stat().st_size:
        try:
            load_model(path)
        except MetadataError as error:
            raise UsageError(**explained("no_model_there", problem=error), where=str(path)) from None
    write_text(path, model_text(model))


def _refused(note: Note) -> LoopReport:
    return LoopReport(str(note.values.get("loop", "")), Verdict.ERROR, (note,))
