"""How a scan is carried out: in processes of this machine, or on a cluster."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING

from .terminal import progress

if TYPE_CHECKING:
    from distributed import Client

    from ..loaders import ReadOptions
    from ..loaders.places import Remote
    from ..loaders.plant import OpenPlant
    from ..record import Record
    from ..results import LoopReport, ScanResult
    from ..scan import ScanOptions


@dataclass
class Job:
    """One scan. client: of the cluster, None for this machine; absolute: its workers are other machines. shown: with
    progress on a terminal. pictures: `records` will be asked for."""

    inputs: Sequence[Path | Remote]
    loops: Path | None
    reading: ReadOptions
    options: ScanOptions
    jobs: int | None = None
    client: Client | None = None
    absolute: bool = False
    shown: bool = True
    pictures: bool = False

    @cached_property
    def records(self) -> Mapping[str, Record]:
        """The loops by name, each read again when it is asked for: pictures need the samples."""
        from ..loaders.recipes import RecordsByName

        return RecordsByName(self._open(self.inputs).recipes)

    def scan(self, inputs: Sequence[Path | Remote] | None = None) -> ScanResult:
        """Return the result of all inputs, or of these."""
        inputs = self.inputs if inputs is None else inputs
        return self._here(inputs) if self.client is None else self._on_cluster(self.client, inputs)

    def _here(self, inputs: Sequence[Path | Remote]) -> ScanResult:
        from ..api import scan
        from ..loaders.recipes import RecordsByName

        plant = self._open(inputs)
        if self.pictures and inputs is self.inputs:
            self.__dict__["records"] = RecordsByName(plant.recipes)
        total = len(plant.recipes)
        with _Counting(total, self.shown) as done:
            return scan(plant, self.options, jobs=self.jobs, progress=done)

    def _open(self, inputs: Sequence[Path | Remote]) -> OpenPlant:
        from ..api import open_files
        from ..loaders.sources import size_of

        with progress("reading", size_of(inputs), shown=self.shown, of_bytes=True) as taken:
            return open_files(list(inputs), loops=self.loops, reading=self.reading, jobs=self.jobs, taken=taken)

    def _on_cluster(self, client: Client, inputs: Sequence[Path | Remote]) -> ScanResult:
        from ..api import scan_part
        from ..engines.plant import DaskPlant

        with progress("looking at the files", None, shown=self.shown):
            plant = DaskPlant(client, inputs, loops=self.loops, reading=self.reading, absolute=self.absolute)
        with _Counting(len(plant.plan.loops), self.shown) as done:
            return plant.scan(partial(scan_part, options=self.options), progress=done)


class _Counting:
    """Counts finished loops, on a bar and for the message when the work is stopped."""

    def __init__(self, total: int, shown: bool) -> None:
        self.total, self.done = total, 0
        self._bar = progress("scanning", total, shown=shown)

    def __enter__(self) -> _Counting:
        self._step = self._bar.__enter__()
        return self

    def __call__(self, report: LoopReport) -> None:
        self.done += 1
        self._step()

    def __exit__(self, kind: type[BaseException] | None, stop: BaseException | None, trace: object) -> None:
        self._bar.__exit__(None, None, None)
        if isinstance(stop, KeyboardInterrupt):
            stop.add_note(f"{self.done} of {self.total} loops were analysed; no report was written")
