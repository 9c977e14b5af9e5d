"""What the command line names: files, folders, datasets, addresses, and the sidecars beside them."""

import contextlib
import os
import re
from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import field
from functools import cache, reduce
from itertools import chain
from operator import truediv
from os import PathLike
from pathlib import Path, PurePath
from typing import Any
from urllib.parse import unquote

from ..errors import InputError, some
from ..places import Remote, place
from ..record import Frozen
from ..settings import Metadata, parse_table, parse_toml
from ..toml_text import read_page
from .names import COLUMNS, FORM, explained, plain, signal_role, undated
from .times import stamp_kind


class Source(Frozen):
    """One file to read. home: loop or tag that its folders name, or "". beside: all files there, None: not listed."""

    path: Path | Remote
    home: str = ""
    beside: frozenset[str] | None = field(default=None, repr=False)

    def mark(self) -> str:
        """Return what changes when the content of the file does, "" where that cannot be known."""
        try:
            now: Any = self.path.stat()
        except OSError:
            return ""
        return now.version if isinstance(self.path, Remote) else f"{now.st_size} {now.st_mtime_ns} {now.st_ctime_ns}"


def find_sources(inputs: Sequence[str | PathLike[str]]) -> list[Source]:
    """Return the files behind the inputs, each once, in order. Raises InputError for what does not exist."""
    if not inputs:
        raise InputError(**explained("no_input"))
    found: dict[str, Source] = {}
    for item in inputs:
        path = place(item)
        try:
            path.stat()
            for source in _below(path) if path.is_dir() else [Source(path)]:
                found.setdefault(str(source.path.absolute()), source)
        except (OSError, ValueError) as odd:  # also for too long a name, or a zero byte in it
            code = "not_found" if isinstance(odd, (FileNotFoundError, NotADirectoryError)) else "cannot_open"
            raise InputError(**explained(code, problem=getattr(odd, "strerror", odd)), where=f"{path!s:.500}") from None
    return list(found.values())


def _below(folder: Path | Remote) -> list[Source]:
    closed = list[OSError]()  # folders that may not be listed become sources that cannot be read
    files = folder.files_below() if isinstance(folder, Remote) else [(*Path(way).relative_to(folder).parts, name)
        for way, _, names in os.walk(folder, onerror=closed.append) for name in names]
    listed: defaultdict[tuple[str, ...], list[str]] = defaultdict(list)  # a folder in or below it -> its files
    for *parts, name in files:
        if not any(part.startswith((".", "_")) for part in parts):
            listed[tuple(parts)].append(name)
    folders = sorted((way, frozenset(names)) for way, names in listed.items())
    alike = Counter(stem for stem, _ in {
        (undated(stem_of(name)), told_by(way, "data.")) for way, names in folders for name in names})
    found = [Source(reduce(truediv, (*way, name), folder), told_by((folder.name, *way), name, alike), beside)
             for way, beside in folders for name in sorted(filter(is_export, beside))]
    found += [Source(Path(error.filename)) for error in closed]
    if not found:
        other = sorted({Path(name).suffix or name for names in listed.values() for name in names})
        there = f"; found there: {some(other)}" if other else "; it is empty"
        raise InputError(**explained("no_exports", there=there), where=str(folder))
    return found


def told_by(folders: Sequence[str], name: str, alike: Counter[str] | None = None) -> str:
    """Return the loop, or tag, that folders on the way to a file name, as loop=FIC101 does; the nearest that is called
    after something where the file is called after its signal, day or number alone, or `alike` others and no number."""
    told = [(plain(key), unquote(value)) for key, equals, value in (part.partition("=") for part in folders) if equals]
    loops, tags = ([value for key, value in told if key in COLUMNS[kind]] for kind in ("loop", "tag"))
    ways, stem = [undated(part) for part in folders if "=" not in part and not FORM.day.fullmatch(part)], stem_of(name)
    of_day = stamp_kind(stem) == "time" or (len(stem) < 3 and bool(FORM.day.fullmatch("".join((*folders[-1:], stem)))))
    stem = ways.pop() if of_day and ways else undated(stem)  # FIC101/2026/03/17.csv
    if ways and len(ways[-1]) == 2 and signal_role(ways[-1]) and not signal_role(stem):  # PV/FIC101.csv
        tags = [f"{stem}.{ways[-1]}"]
    many = alike is not None and alike[stem] > 1 and not re.search(r"\d", stem)
    if not loops and not tags and (many or FORM.numbered.match(f"{stem}.") or signal_role(stem) or of_day):
        loops = [*[stem] * (of_day and not signal_role(stem)), *reversed(ways)]
    signal = next(filter(signal_role, tags), stem if loops and signal_role(stem) else "")
    return ".".join([*[one for one in (*loops[:1], *tags) if one != signal][:1], signal]).rstrip(".")


def is_export(name: str) -> bool:
    """Say whether a file name has the ending of an export and is no sidecar, no readme."""
    return bool((found := FORM.file.fullmatch(name)) and found["kind"]) and not FORM.no_export.search(name)


def stem_of(name: str) -> str:
    """File name without the endings of its format: FIC101.PV.csv.gz -> FIC101.PV."""
    return found["stem"] if (found := FORM.file.fullmatch(name)) else name


def day_of(name: str) -> str:
    """Return the day in a file's name, "" where there is none: FIC101_20260302_2155.csv -> 20260302."""
    stem = stem_of(name)
    day = stem.replace(undated(stem), "").strip(" _.-").replace("_", "-") or stem
    return day[: 8 if day[:8].isdigit() else 10] * (stamp_kind(day) == "time")


def find_sidecars(inputs: Sequence[str | PathLike[str]], sources: Sequence[Source]) -> list[Path | Remote]:
    """Return the metadata files of the inputs, the deepest first: NAME.loops.toml, else loops.toml, or in CSV."""
    @cache
    def first(folder: Path | Remote, *names: str, beside: frozenset[str] | None = None) -> list[Path | Remote]:
        found = ([path for path in (folder / f"{name}.toml", folder / f"{name}.csv")
                  if path not in data and there(path, beside)] for name in names)
        return next(filter(None, found), [])

    def there(path: Path | Remote, beside: frozenset[str] | None) -> bool:
        with contextlib.suppress(InputError, OSError):  # some stores answer "denied" for what is not there
            return path.name in beside if beside is not None else path.is_file() or (
                isinstance(path, Path) and os.path.lexists(path))
        return False

    folders, data = [path for path in map(place, inputs) if path.is_dir()], {source.path for source in sources}
    found = [first(path.parent, f"{path.name}.loops") or first(path, "loops") for path in folders]
    for source in sources:
        folder, name, beside = source.path.parent, source.path.name, source.beside
        found.append(first(folder, *(f"{one}.loops" for one in (stem_of(name), name, undated(stem_of(name)))),
                           beside=beside) or first(folder, "loops", beside=beside))
    if not any(found):
        found = [first(path.absolute().parent, "loops") for path in folders]
    return sorted(dict.fromkeys(chain(*found)), key=lambda path: -len(PurePath(path).parts))


def read_metadata(path: str | PathLike[str]) -> Metadata:
    """Read loop settings: TOML, or a CSV table with a column `loop`. Raises MetadataError naming file, line and key."""
    table = Path(place(path).name).suffix.lower() in (".csv", ".txt", ".tsv")  # a spreadsheet has a code page
    parse, code = (parse_table, "cp1252") if table else (parse_toml, "utf-8")
    return parse(read_page(path, "the loops file", "name a TOML or CSV file that can be read", code), str(path))
