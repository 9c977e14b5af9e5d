"""What the nightly job needs before it begins: its configuration, the exports there are, and a lock."""

from __future__ import annotations

import contextlib
import glob
import hashlib
import os
import re
import socket
import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from datetime import date, datetime
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec

from ..errors import BacklashError, MetadataError, UsageError, nearest
from ..record import Frozen
from ..results import LoopReport
from ..results.history import DAY
from ..toml_text import Page, checked, line_of, parsed, read_page
from ..words import WORDS, explained

READING = ("time_format", "timezone", "interpolation", "delimiter", "decimal", "encoding", "layout", "columns",
           "header_row", "only_loops", "good_quality", "auto_modes")
_DATE = re.compile(r"\{date(?::([^{}]*))?\}")
NO_DAY = date.max
CODES = "YymdjHMSb%"  # of a date, as in strftime; each is written in as many characters every day
Count = Annotated[int, msgspec.Meta(gt=0, lt=1_000_000)]


class Outputs(Page, frozen=True):
    """report: .html or folder; scan: of each night, `{date}` in its name; trend: JSON; keep: how many scans stay."""

    report: Path | None = None
    scan: Annotated[str, msgspec.Meta(pattern=r"(?i)\{date.*\.(html|json|csv|parquet)$")] | None = None
    trend: Path | None = None
    keep: Count = 30


class LogFile(Page, frozen=True):
    """file: None is standard error."""

    file: Path | None = None
    format: Literal["text", "json"] = "text"


class NightlyConfig(Page, frozen=True):
    """What the nightly job does; all paths as they are from here.

    inputs: patterns of exports; `{date}` or `{date:%Y%m%d}` stands for the day, `*` and `?` for any characters.
    together: exports without a date are one plant, not one night each. look_back: days before the newest export that
    are looked at. reading: options of how to read exports, as read_config is told. path: of this page itself."""

    inputs: str | Annotated[tuple[str, ...], msgspec.Meta(min_length=1)]
    history: Path
    lock: Path = Path()
    loops: Path | None = None
    limits: Path | None = None
    horizon: Annotated[float, msgspec.Meta(gt=0, lt=1e6)] = 90.0
    fail_on: str | tuple[str, ...] = ()
    together: bool = False
    look_back: Count = 14
    jobs: Count | None = None
    outputs: Outputs = Outputs()
    log: LogFile = LogFile()
    reading: Any = msgspec.field(default_factory=dict)
    path: Path = msgspec.field(name="(this page)", default=Path())


def read_config(path: str | Path, reading: type = dict) -> NightlyConfig:
    """Read the configuration of the nightly job. reading: the type of the options on how to read exports.

    Raises MetadataError naming the file, the key, and the remedy."""
    path, example = Path(path), "docs/nightly.md shows an example"

    def beside(kind: type, value: Any) -> Path:
        if not isinstance(value, str):
            raise TypeError("Expected `str`")
        return path.parent / Path(value).expanduser()

    text, where = read_page(path, "the configuration", f"check the path; {example}"), str(path)
    page = checked(parsed(text, where), NightlyConfig, where, text, remedy=example, hook=beside,
                   words=WORDS["nightly_file"])
    for key in [key for key in page.reading if key not in READING]:
        raise MetadataError(**explained("unknown_key", key=key, hint=nearest(key, READING)),
                            where=line_of(text, where, "reading", key))
    try:
        options: Any = checked(page.reading, reading, where, text, "reading")
    except UsageError as error:  # it names what it would be on the command line
        error.where = line_of(text, where, "reading", error.where.removeprefix("--").replace("-", "_"))
        raise
    inputs, fail_on = ((value,) if isinstance(value, str) else value for value in (page.inputs, page.fail_on))
    return msgspec.structs.replace(page, path=path, inputs=tuple(str(beside(Path, one)) for one in inputs),
        fail_on=fail_on, lock=page.lock if page.lock.name else page.history.with_name(page.history.name + ".lock"),
        outputs=msgspec.structs.replace(page.outputs, scan=page.outputs.scan and str(path.parent / page.outputs.scan)),
        reading=options)


class DatedExport(Frozen):
    """The files of one night. name: the date in their names, or the file name where there is none."""

    name: str
    files: tuple[Path, ...]
    date: date | None = None

    def misdated(self, reports: Iterable[LoopReport]) -> bool:
        """Whether all data lie further from the day in the name than a time zone, or a delivery next morning, tells."""
        day = 0.0 if self.date is None else (self.date - date(1970, 1, 1)).days * DAY
        ends = [(r.start, r.end) for r in reports if r.start and r.end and r.start > 365 * DAY]  # of the calendar
        return day > 0.0 and bool(ends) and all(end < day - 1.5 * DAY or day + 2.5 * DAY < start for start, end in ends)

    def fingerprint(self, more: Sequence[Path] = (), salt: str = "") -> str:
        """Return a fingerprint of the files' content (and of `more` files, such as settings)."""
        total = hashlib.sha256(salt.encode())
        for path in sorted((*self.files, *more)):
            with open(path, "rb") as stream:
                total.update(hashlib.file_digest(stream, "sha256").digest())
        return total.hexdigest()[:32]


def check_places(config: NightlyConfig, exports: Sequence[DatedExport], read: Iterable[Path]) -> None:
    """Raise MetadataError where the job would write over what it reads, or two things to one place."""
    out, scan = config.outputs, config.outputs.scan or ""
    scans = {expand(scan, export.name) for export in exports} | {str(path) for path, _ in matches(scan)}  # old ones go
    own = {path.resolve() for path in (config.path, config.loops, config.limits, *read) if path}
    written = [Path(path).resolve() for path in (config.history, config.lock, config.log.file, out.report, out.trend,
                                                 *scans) if path]
    if twice := next((path for path in written if path in own or written.count(path) > 1), None):
        raise MetadataError(**explained("one_file_twice", file=twice.name), where=str(config.path))


def find_exports(patterns: Iterable[str], *, together: bool = False, look_back: int = 14
                 ) -> tuple[list[DatedExport], list[str], list[str]]:
    """Return exports in the order of their dates, the names of those over `look_back` days before the newest, and what
    gives none: patterns that no file matches, files of a day that no calendar has.

    Files of one date are one plant. Without `{date}` every file is an export by itself, or all are one (`together`)."""
    nights: dict[date | str, list[Path]] = {}
    behind = {pattern: matches(pattern) for pattern in patterns}
    days = dict(sorted((match for found in behind.values() for match in found), key=lambda match: match[1] is not None))
    nothing = [pattern for pattern, found in behind.items() if not found]
    nothing += [f"{path.name} (no such day)" for path, day in sorted(days.items()) if day == NO_DAY]
    for path, day in sorted(item for item in days.items() if item[1] != NO_DAY):  # a date of any pattern counts
        nights.setdefault(day or ("" if together else str(path)), []).append(path)
    dated = sorted(day for day in nights if isinstance(day, date))
    older = [day.isoformat() for day in dated if (dated[-1] - day).days > look_back]
    others = [files for day, files in nights.items() if isinstance(day, str)]
    called = Counter(files[0].name for files in others)
    exports = [*(DatedExport(day.isoformat(), tuple(nights[day]), day) for day in dated[len(older) :]),
               *(DatedExport(name if called[name := files[0].name] < 2 else str(files[0].resolve()), tuple(files))
                 for files in others)]
    return exports, older, nothing


def matches(pattern: str) -> list[tuple[Path, date | None]]:
    """Return the files behind one pattern with the date in their names: None where the pattern has none, NO_DAY for one
    that is none of the calendar."""
    wild, expression, formats = "", "", []
    for i, piece in enumerate(_DATE.split(pattern)):  # text and date formats by turns
        if i % 2:
            form = piece or "%Y-%m-%d"
            if strange := re.search(f"%([^{CODES}]|$)", form):
                codes = ", ".join(f"%{code}" for code in CODES[:-1])
                raise MetadataError(**explained("no_date_code", code=strange[0], codes=codes), where=pattern)
            formats.append(form)
            wild += re.sub("[^/]+", "*", form)
            expression += f"(.{{{len(date(2026, 12, 31).strftime(form))}}})"
        else:
            wild += piece.replace("[", "[[]")
            expression += re.escape(piece).replace(r"\*\*/", "(?:.*/)?").replace(r"\*", "[^/]*").replace(r"\?", "[^/]")
    out: list[tuple[Path, date | None]] = []
    for name in sorted(glob.glob(wild, recursive=True)):
        found = re.fullmatch(expression, name)
        if found is None or not Path(name).is_file():
            continue
        parts = [*zip(found.groups(), formats, strict=True)]
        try:
            days = {*list[date | None](datetime.strptime(*pair).date() for pair in parts)}
        except ValueError:
            digits = all(re.fullmatch(re.sub("%.", r"\\d+", re.escape(form)), part) for part, form in parts)
            days = {NO_DAY} if digits else {NO_DAY, None}  # of other letters it is no export of a night
        if len(days) <= 1:
            out.append((Path(name), days.pop() if days else None))
    return out


def expand(pattern: str, name: str) -> str:
    """Return `pattern` with `{date}` filled in; a night without a date in its name stands for itself."""
    def fill(found: re.Match[str]) -> str:
        with contextlib.suppress(ValueError):
            return date.fromisoformat(name).strftime(found[1] or "%Y-%m-%d")
        return re.sub(r"[^A-Za-z0-9._-]+", "_", name)

    return _DATE.sub(fill, pattern)


@contextlib.contextmanager
def lock(path: Path) -> Iterator[str]:
    """Hold the lock file at `path`; gives a remark on a stale lock that was taken over, else an empty text.

    The operating system gives the lock back when a run dies. The file holds process and host of the run that works and
    is empty when none does: one that is not empty and that nobody holds was left by a run that was killed. Raises
    BacklashError when another run works."""
    try:
        file = open(path, "a+b", buffering=0)  # noqa: SIM115
    except OSError as error:
        raise BacklashError(**explained("lock", problem=error.strerror), where=str(path)) from None
    with file:
        taken = False
        with contextlib.suppress(OSError):
            if sys.platform == "win32":
                import msvcrt

                file.seek(1 << 20)  # beyond the text, which others must be able to read
                msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
            else:
                import fcntl

                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            taken = True
        file.seek(0)
        before = file.read(200).decode("utf-8", "replace").strip()
        if not taken or (before and not before.startswith("process ")):  # what is no lock stays as it is
            name = "lock:other" if taken else "busy"
            raise BacklashError(**explained(name, who=before or "unknown"), where=str(path))
        file.truncate(0)
        file.write(f"process {os.getpid()} on {socket.gethostname()}\n".encode())
        try:
            yield f"the last job ({before}) was stopped before its end; its lock is taken over" if before else ""
        finally:
            file.truncate(0)
