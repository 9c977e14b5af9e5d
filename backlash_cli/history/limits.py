"""Which dead band is too much for which loop, and who says so: the editable profile `limits.toml`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any

import msgspec

from ..errors import MetadataError, nearest
from ..results.history import Limit
from ..toml_text import parsed, read_page
from .pages import Page, checked


class _Profile(Page, frozen=True):
    default: str | None = None
    classes: Mapping[str, Any] = {}
    assign: Sequence[Any] = ()
    loops: Mapping[str, Any] = {}


class _Entry(Page, frozen=True):
    limit: Annotated[float, msgspec.Meta(gt=0, le=100)]
    source: str = "not given"


class _OfClass(Page, frozen=True):
    name: str = msgspec.field(name="class")


class _Assign(_OfClass, frozen=True):
    loops: str | Annotated[list[str], msgspec.Meta(min_length=1)]


_WORDS = {"": "a table with a number `limit`", "limit": "a number of per cent between 0 and 100",
          "loops": "a name, a pattern, or a list of them"}


@dataclass(frozen=True)
class Limits:
    """Limits of all loops: classes by name, patterns in order, single loops, and the class of all others."""

    classes: Mapping[str, Limit]
    default: str
    assign: tuple[tuple[str, str], ...] = ()
    loops: Mapping[str, Limit] = field(default_factory=dict)

    def of(self, loop: str) -> Limit:
        """Return the limit of a loop: its own, else that of the first pattern that fits, else the default's."""
        if loop in self.loops:
            return self.loops[loop]
        fitting = (name for pattern, name in self.assign if fnmatchcase(loop.lower(), pattern.lower()))
        return self.classes[next(fitting, self.default)]

    def known(self, name: str, where: str) -> str:
        """Return the name of a class. Raises MetadataError where the profile has none of that name."""
        if name not in self.classes:
            raise MetadataError(f"no class {name!r}", where=where, remedy=nearest(name, self.classes))
        return name

    def with_classes(self, chosen: Mapping[str, str], default: str | None, where: str) -> Limits:
        """Return a copy in which loops have the class that their settings name; the profile's own loops go first.

        chosen: loop -> class, default: class of the loops that have none, both from the loops file `where`.
        Raises MetadataError for a class that the profile does not know.
        """
        where = f"{where}, limit_class"
        loops = {loop: self.classes[self.known(name, where)] for loop, name in chosen.items()}
        return replace(self, default=self.default if default is None else self.known(default, where),
                       loops={**loops, **self.loops})


def read_limits(path: str | Path | None = None) -> Limits:
    """Read a limits profile; without `path` the one that comes with the tool.

    Raises MetadataError naming the file, the entry, and the remedy.
    """
    if path is None:
        return parse_limits(files("backlash_cli.history").joinpath("limits.toml").read_text("utf-8"), "limits.toml")
    return parse_limits(read_page(path, "the limits profile", "check the path given to --limits"), str(path))


def parse_limits(text: str, where: str) -> Limits:
    """Read a limits profile from TOML text; limits in per cent of the output span."""
    page = checked(parsed(text, where), _Profile, where, remedy="see the profile that comes with the tool")
    classes = {name: _limit(entry, name, f"{where}, [classes.{name}]") for name, entry in page.classes.items()}
    if not classes:
        raise MetadataError("no class of limits", where=where, remedy="add [classes.NAME] with limit = 3.0")
    limits = Limits(classes, next(iter(classes)) if page.default is None else page.default)
    limits.known(limits.default, f"{where}, default")
    assign = []
    for number, entry in enumerate(page.assign, 1):
        place = f"{where}, [[assign]] number {number}"
        one = checked(entry, _Assign, place, words=_WORDS, remedy='for example loops = ["FIC1*"] and class = "fine"')
        patterns = [one.loops] if isinstance(one.loops, str) else one.loops
        assign += [(pattern, limits.known(one.name, place)) for pattern in patterns]
    loops = {}
    for name, entry in page.loops.items():
        place = f"{where}, [loops.{name}]"
        if isinstance(entry, dict) and "class" in entry:
            loops[name] = classes[limits.known(checked(entry, _OfClass, place, remedy="see the classes").name, place)]
        else:
            loops[name] = _limit(entry, name, place)
    return replace(limits, assign=tuple(assign), loops=loops)


def _limit(entry: Any, name: str, where: str) -> Limit:
    found = checked(entry, _Entry, where, words=_WORDS, remedy="for example limit = 3.0")
    return Limit(found.limit / 100.0, name, found.source)
