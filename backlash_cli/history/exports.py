"""Which exports there are, by night: found by pattern, grouped by the date in the name, late and missing ones named."""

from __future__ import annotations

import glob
import hashlib
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import date, datetime, timedelta
from pathlib import Path

from ..errors import MetadataError

_DATE = re.compile(r"\{date(?::([^{}]*))?\}")
_TOKENS = {"%Y": r"\d{4}", "%y": r"\d{2}", "%m": r"\d{2}", "%d": r"\d{2}", "%j": r"\d{3}", "%H": r"\d{2}",
           "%M": r"\d{2}", "%S": r"\d{2}", "%b": r"[A-Za-z]{3}", "%%": "%"}


@dataclass(frozen=True)
class Export:
    """The files of one night. name: the date in their names, or the file name where there is none."""

    name: str
    files: tuple[Path, ...]
    date: date | None = None

    def fingerprint(self, more: Sequence[Path] = (), salt: str = "") -> str:
        """Return a fingerprint of the files' content (and of `more` files, such as settings)."""
        total = hashlib.sha256(salt.encode())
        for path in sorted((*self.files, *more)):
            with open(path, "rb") as stream:
                total.update(hashlib.file_digest(stream, "sha256").digest())
        return total.hexdigest()[:32]


def find_exports(patterns: Iterable[str], *, together: bool = False, look_back: int = 14) -> list[Export]:
    """Return the exports behind the patterns in the order of their dates, at most `look_back` days before the newest.

    Files of one date are one plant. Without `{date}` every file is an export by itself, or all are one (`together`).
    """
    dated: dict[date, list[Path]] = {}
    plain: list[Path] = []
    for pattern in patterns:
        for path, day in matches(pattern):
            if day is None:
                plain.append(path)
            else:
                dated.setdefault(day, []).append(path)
    newest = max(dated, default=None)
    out = [Export(day.isoformat(), tuple(sorted(set(files))), day) for day, files in sorted(dated.items())
           if newest is not None and (newest - day).days <= look_back]
    files = tuple(sorted(set(plain)))
    if together and files:
        return [*out, Export(files[0].name, files)]
    return [*out, *(Export(path.name, (path,)) for path in files)]


def missing_dates(exports: Sequence[Export]) -> list[str]:
    """Return the days between the first and the last dated export for which there is none."""
    days = {e.date for e in exports if e.date is not None}
    if not days:
        return []
    span = (max(days) - min(days)).days
    return [day.isoformat() for k in range(span) if (day := min(days) + timedelta(days=k)) not in days]


def matches(pattern: str) -> list[tuple[Path, date | None]]:
    """Return the files behind one pattern with the date in their names (None where the pattern has none)."""
    wild, expression, formats = "", "", []
    for i, piece in enumerate(_DATE.split(pattern)):  # text and date formats by turns
        if i % 2:
            formats.append(piece or "%Y-%m-%d")
            wild += re.sub("[^/]+", "*", formats[-1])
            expression += f"({_format_expression(formats[-1], pattern)})"
        else:
            wild += piece.replace("[", "[[]")
            expression += re.escape(piece).replace(r"\*\*/", "(?:.*/)?").replace(r"\*", "[^/]*").replace(r"\?", "[^/]")
    out: list[tuple[Path, date | None]] = []
    for name in sorted(glob.glob(wild, recursive=True)):
        found = re.fullmatch(expression, name)
        if found is None or not Path(name).is_file():
            continue
        if not formats:
            out.append((Path(name), None))
            continue
        try:
            days = {datetime.strptime(text, form).date() for text, form in zip(found.groups(), formats, strict=True)}
        except ValueError:
            continue
        if len(days) == 1:
            out.append((Path(name), days.pop()))
    return out


def expand(pattern: str, name: str) -> str:
    """Return `pattern` with `{date}` filled in; a night without a date in its name stands for itself."""
    def fill(found: re.Match[str]) -> str:
        try:
            return date.fromisoformat(name).strftime(found[1] or "%Y-%m-%d")
        except ValueError:
            return re.sub(r"[^A-Za-z0-9._-]+", "_", name)

    return _DATE.sub(fill, pattern)


def _format_expression(form: str, pattern: str) -> str:
    out = ""
    for token in re.findall(r"%.|[^%]+|%", form):
        if token.startswith("%") and token not in _TOKENS:
            raise MetadataError(f"{token!r} is not known in a date", where=pattern,
                                remedy=f"use {', '.join(t for t in _TOKENS if t != '%%')}")
        out += _TOKENS.get(token, re.escape(token))
    return out
