"""What the command line names: files, folders of exports, Parquet datasets, and the sidecars next to them."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from urllib.parse import unquote

from ..errors import InputError
from .tables import stem_of

TEXT = (".csv", ".tsv", ".txt", ".dat", ".asc")
PARQUET = (".parquet", ".pq")
PACKED = (".gz", ".zst", ".zstd", ".bz2", ".xz")
MAX_FILES = 200_000


@dataclass(frozen=True)
class Source:
    """One file to read. partition: names and values of folders like loop=FIC101 on the way to it."""

    path: Path
    partition: dict[str, str] = field(default_factory=dict)


def find_sources(inputs: str | PathLike[str] | Sequence[str | PathLike[str]]) -> list[Source]:
    """Return the files behind the inputs, each once, in order. Raises InputError for what does not exist."""
    given = [inputs] if isinstance(inputs, (str, PathLike)) else list(inputs)
    if not given:
        raise InputError("no input given", remedy="name an export file or a folder of exports")
    found: list[Source] = []
    for item in given:
        if "\x00" in os.fspath(item):
            raise InputError("a file name holds a zero byte", remedy="check the name")
        path = Path(item)
        try:
            if path.is_dir():
                found.extend(_below(path))
            elif path.exists():
                found.append(Source(path))
            else:
                raise InputError(
                    "no such file or folder: not found", where=str(path), remedy="check the name and the path"
                )
        except OSError as error:
            raise InputError(f"cannot open: {error.strerror}", where=str(path)[:200]) from None
    unique: dict[str, Source] = {}
    for source in found:
        unique.setdefault(str(source.path.absolute()), source)
    return list(unique.values())


def is_export(name: str) -> bool:
    """Say whether a file name has the ending of an export and is no sidecar."""
    lower = name.lower()
    for ending in PACKED:
        lower = lower.removesuffix(ending)
    if lower.startswith((".", "_")) or lower == "loops.csv" or lower.endswith(".loops.csv"):
        return False
    return lower.endswith(TEXT + PARQUET)


def _below(folder: Path) -> list[Source]:
    found: list[Source] = []
    for root, folders, names in os.walk(folder):
        folders[:] = sorted(name for name in folders if not name.startswith((".", "_")))
        partition = {}
        for part in Path(root).relative_to(folder.parent).parts:
            key, equals, value = part.partition("=")
            if equals:
                partition[key] = unquote(value)
        found += [Source(Path(root, name), partition) for name in sorted(names) if is_export(name)]
        if len(found) > MAX_FILES:
            raise InputError(f"more than {MAX_FILES} files", where=str(folder), remedy="scan it in parts")
    if not found:
        raise InputError(
            "folder holds no exports (no CSV or Parquet files)",
            where=str(folder),
            remedy="name the folder with the exports, or a file",
        )
    return found


def find_sidecars(inputs: Sequence[str | PathLike[str]], sources: Sequence[Source]) -> list[Path]:
    """Return the metadata files that belong to the inputs: NAME.loops.toml next to it, else loops.toml in the folder.

    A CSV table (NAME.loops.csv, loops.csv) is found the same way when there is no TOML.
    """
    found: dict[Path, None] = {}
    for item in inputs:
        path = Path(item)
        if path.is_dir():
            for sidecar in (*_candidates(path.parent, path.name), *_plain(path)):
                if sidecar.is_file():
                    found.setdefault(sidecar)
                    break
    seen: dict[Path, Path | None] = {}
    for source in sources:
        folder = source.path.parent
        own = next((c for c in _candidates(folder, stem_of(source.path), source.path.name) if c.is_file()), None)
        if own is None:
            if folder not in seen:
                seen[folder] = next((c for c in _plain(folder) if c.is_file()), None)
            own = seen[folder]
        if own is not None:
            found.setdefault(own)
    if not found:
        for item in inputs:
            path = Path(item)
            if path.is_dir():
                up = next((c for c in _plain(path.absolute().parent) if c.is_file()), None)
                if up is not None:
                    found.setdefault(up)
    return list(found)


def _candidates(folder: Path, *names: str) -> list[Path]:
    return [folder / f"{name}.loops.{ending}" for name in names for ending in ("toml", "csv")]


def _plain(folder: Path) -> list[Path]:
    return [folder / "loops.toml", folder / "loops.csv"]
