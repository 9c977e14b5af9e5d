"""What the command line names: files, folders of exports, Parquet datasets, and the sidecars next to them."""

from __future__ import annotations

import contextlib
import os
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from urllib.parse import unquote

from ..errors import BacklashError, InputError, MetadataError
from ..settings import Metadata, parse_table, parse_toml
from .names import LOOP, TAG, plain
from .remote import Remote, place

TEXT = (".csv", ".tsv", ".txt", ".dat", ".asc")
PARQUET = (".parquet", ".pq")
WORKBOOK = (".xlsx", ".xlsm")
PACKED = (".gz", ".zst", ".zstd", ".bz2", ".xz")
MAX_FILES = 200_000
SIZE_LIMIT = 32 << 20  # bytes of a loops file
_PART = re.compile(r"(?:part|data|chunk)[-_.]\d", re.IGNORECASE)  # pieces of a dataset as Arrow, Spark, Dask call them
_DATE = re.compile(r"[\d._-]+")


@dataclass(frozen=True)
class Source(PathLike[str]):
    """One file to read. partition: names and values of folders like loop=FIC101 on the way to it.

    beside: names of all files in the same folder, None where they were not listed.
    """

    path: Path | Remote
    partition: dict[str, str] = field(default_factory=dict)
    beside: frozenset[str] | None = field(default=None, repr=False)

    def __fspath__(self) -> str:
        return str(self.path)

    def mark(self) -> str:
        """Return what changes when the content of the file does, "" where that cannot be known."""
        try:
            if isinstance(self.path, Remote):
                version = self.path.version()
                return version if " " in version else ""  # its size alone says too little
            about = self.path.stat()
            return f"{about.st_size} {about.st_mtime_ns} {about.st_ctime_ns}"
        except OSError:
            return ""


def find_sources(inputs: str | PathLike[str] | Sequence[str | PathLike[str]]) -> list[Source]:
    """Return the files behind the inputs, each once, in order. Raises InputError for what does not exist."""
    given = [inputs] if isinstance(inputs, (str, PathLike)) else list(inputs)
    if not given:
        raise InputError("no input given", remedy="name an export file or a folder of exports")
    found: list[Source] = []
    for item in given:
        if isinstance(item, Source):
            found.append(item)
            continue
        if "\x00" in os.fspath(item):
            raise InputError("a file name holds a zero byte", remedy="check the name")
        path = place(item)
        try:
            if path.is_dir():
                found.extend(_below(path))
            elif path.exists():
                found.append(Source(path))
            else:
                raise InputError("no such file or folder: not found", where=str(path),
                                 remedy="check the name and the path")
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
    return lower.endswith(TEXT + PARQUET + WORKBOOK) and not lower.startswith("~$")


def _below(folder: Path | Remote) -> list[Source]:
    found: list[Source] = []
    seen: list[str] = []
    for parts, names in _folders_of(folder):
        seen += names
        partition = {}
        for part in (folder.name, *parts):
            key, equals, value = part.partition("=")
            if equals:
                partition[key] = unquote(value)
        beside = frozenset(names)
        here = folder
        for part in parts:
            here = here / part
        named = any(plain(key) in LOOP | TAG for key in partition)
        home = "" if named else _home((folder.name, *parts))
        for name in sorted(names):
            if is_export(name):
                own = {**partition, "loop": home} if home and _PART.match(name) else partition
                found.append(Source(here / name, own, beside))
        if len(found) > MAX_FILES:
            raise InputError(f"more than {MAX_FILES} files", where=str(folder), remedy="scan it in parts")
    if not found:
        other = sorted({Path(name).suffix or name for name in seen})
        there = f"; found there: {', '.join(other[:8])}" + ", ..." * (len(other) > 8) if other else "; it is empty"
        raise InputError(f"folder holds no exports (no CSV, Parquet or Excel files){there}", where=str(folder),
                         remedy="name the folder with the exports, or a file")
    return found


def _home(parts: Sequence[str]) -> str:
    """The nearest folder that is called after something: no key=value, no date."""
    return next((part for part in reversed(parts) if "=" not in part and not _DATE.fullmatch(part)), "")


def _folders_of(folder: Path | Remote) -> Iterator[tuple[tuple[str, ...], list[str]]]:
    """Yield every folder in and below a folder, as its parts below it and the names of its files, in order."""
    if isinstance(folder, Remote):
        listed: dict[tuple[str, ...], list[str]] = {}
        for parts in folder.files_below():
            if not any(part.startswith((".", "_")) for part in parts[:-1]):
                listed.setdefault(parts[:-1], []).append(parts[-1])
        yield from listed.items()
        return
    for root, folders, names in os.walk(folder):
        folders[:] = sorted(name for name in folders if not name.startswith((".", "_")))
        yield Path(root).relative_to(folder).parts, names


def find_sidecars(inputs: Sequence[str | PathLike[str]], sources: Sequence[Source]) -> list[Path | Remote]:
    """Return the metadata files that belong to the inputs: NAME.loops.toml next to it, else loops.toml in the folder.

    A CSV table (NAME.loops.csv, loops.csv) is found the same way when there is no TOML.
    """
    folders = [path for path in map(place, inputs) if path.is_dir()]

    def first(candidates: Iterable[Path | Remote], source: Source | None = None) -> Path | Remote | None:
        return next((c for c in candidates if _there(c, source)), None)

    found = [first((*_named(path.parent, path.name), *_plain(path))) for path in folders]
    plain: dict[Path | Remote, Path | Remote | None] = {}
    for source in sources:
        folder = source.path.parent
        own = first(_named(folder, stem_of(source.path), source.path.name), source)
        if own is None:
            if folder not in plain:
                plain[folder] = first(_plain(folder), source)
            own = plain[folder]
        found.append(own)
    if not any(found):
        found = [first(_plain(path.absolute().parent)) for path in folders]
    return [path for path in dict.fromkeys(found) if path is not None]


def _there(sidecar: Path | Remote, source: Source | None) -> bool:
    """Whether a file stands beside a source; asked of the listing where there is one, which costs nothing."""
    if source is not None and source.beside is not None:
        return sidecar.name in source.beside
    with contextlib.suppress(InputError):  # some stores answer "denied" for an object that is not there
        return sidecar.is_file()
    return False


def _named(folder: Path | Remote, *names: str) -> list[Path | Remote]:
    return [folder / f"{name}.loops.{ending}" for name in names for ending in ("toml", "csv")]


def _plain(folder: Path | Remote) -> list[Path | Remote]:
    return [folder / "loops.toml", folder / "loops.csv"]


def stem_of(path: Path | Remote) -> str:
    """File name without the endings of its format: FIC101.PV.csv.gz -> FIC101.PV."""
    name = path.name
    for endings in (PACKED, TEXT + PARQUET + WORKBOOK):
        for ending in endings:
            if name.lower().endswith(ending) and len(name) > len(ending):
                name = name[: -len(ending)]
                break
    return name


def read_metadata(path: str | PathLike[str]) -> Metadata:
    """Read one metadata file: TOML with [defaults] and [loops.NAME], or a CSV table with a column `loop`.

    Raises MetadataError naming file, line and key, with the nearest known ones.
    """
    path = place(path)
    try:
        if path.stat().st_size > SIZE_LIMIT:
            raise MetadataError("metadata file is larger than 32 MB", where=str(path), remedy="is this the data file?")
        text = path.read_bytes().decode("utf-8-sig")
    except FileNotFoundError:
        raise MetadataError("loops file not found: no such file", where=str(path),
                            remedy="check the path given to --loops") from None
    except OSError as error:
        raise MetadataError(f"cannot read the loops file: {error.strerror}", where=str(path)) from None
    except UnicodeDecodeError as error:
        raise MetadataError(f"loops file is not UTF-8 text (byte {error.start})", where=str(path),
                            remedy="save it as UTF-8") from None
    parse = parse_table if path.suffix.lower() in (".csv", ".txt", ".tsv") else parse_toml
    return parse(text, str(path))


def size_of(inputs: Sequence[str | PathLike[str]]) -> int | None:
    """Return the bytes of all files behind the inputs on this machine, None where that cannot be known quickly."""
    try:
        return sum(source.path.stat().st_size for source in find_sources(list(inputs)) if isinstance(source.path, Path))
    except (BacklashError, OSError):
        return None
