"""Which dead band is too much for which loop, and who says so: the editable profile `limits.toml`."""

from collections.abc import Mapping, Sequence
from dataclasses import field, replace
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import msgspec

from ..errors import MetadataError, nearest
from ..record import Frozen
from ..results.history import Limit
from ..selection import fits
from ..toml_text import Page, checked, line_of, parsed, read_page
from ..words import WORDS

if TYPE_CHECKING:
    from ..settings import Metadata


class _Profile(Page, frozen=True):
    default: str | None = None
    classes: Mapping[str, Any] = {}
    assign: Sequence[Any] = ()
    loops: Mapping[str, Any] = {}


class _Entry(Page, frozen=True):
    limit: Annotated[float, msgspec.Meta(ge=0.1, le=100)]
    source: str = "not given"


class _OfClass(Page, frozen=True):
    name: str = msgspec.field(name="class")


class _Assign(_OfClass, frozen=True):
    loops: str | Annotated[list[str], msgspec.Meta(min_length=1)]


class Limits(Frozen):
    """Limits of all loops: classes by name, patterns in order, single loops, and the class of all others."""

    classes: Mapping[str, Limit]
    default: str
    assign: tuple[tuple[str, str], ...] = ()
    loops: Mapping[str, Limit] = field(default_factory=dict)

    def of(self, loop: str) -> Limit:
        """Return the limit of a loop: its own, else that of the first pattern that fits, else the default's."""
        fitting = (name for pattern, name in self.assign if fits(loop, [pattern]))
        return self.loops.get(loop) or self.classes[next(fitting, self.default)]

    def known(self, name: str, where: str) -> str:
        """Return the name of a class. Raises MetadataError where the profile has none of that name."""
        if name not in self.classes:
            raise MetadataError(f"no class {name!r}", where=where, remedy=nearest(name, self.classes))
        return name

    def with_classes(self, settings: "Metadata", where: str) -> "Limits":
        """Return a copy in which loops have the class that their settings name; the profile's own loops go first.

        settings: of the loops file `where`. Raises MetadataError for a class that the profile does not know."""
        def named(values: Mapping[str, Any]) -> str:
            return self.known(str(values["limit_class"]), f"{where}, limit_class")

        loops = {loop: self.classes[named(own.values)] for loop, own in settings.loops.items()
                 if "limit_class" in own.values and "limit_class" not in own.from_defaults}
        default = named(settings.defaults) if "limit_class" in settings.defaults else self.default
        return replace(self, default=default, loops={**loops, **self.loops})


def read_limits(path: str | Path | None = None) -> Limits:
    """Read a limits profile; without `path` the one that comes with the tool.

    Raises MetadataError naming the file, the entry, and the remedy."""
    if path is None:
        return parse_limits(files("backlash_cli.history").joinpath("limits.toml").read_text("utf-8"), "limits.toml")
    remedy = "check the path (--limits, or limits in the nightly configuration)"
    return parse_limits(read_page(path, "the limits profile", remedy), str(path))


def parse_limits(text: str, where: str) -> Limits:
    """Read a limits profile from TOML text; limits in per cent of the output span."""
    def limit(entry: Any, *way: str) -> Limit:
        found = checked(entry, _Entry, where, text, *way, words=WORDS["limits_file"])
        return Limit(found.limit / 100.0, way[-1], found.source)

    page = checked(parsed(text, where), _Profile, where, text)
    classes = {name: limit(entry, "classes", name) for name, entry in page.classes.items()}
    if not classes:
        raise MetadataError("no class of limits", where=where, remedy="add [classes.NAME] with limit = 3.0")
    limits = Limits(classes, next(iter(classes)) if page.default is None else page.default)
    limits.known(limits.default, line_of(text, where, "default"))
    assign = []
    for number, entry in enumerate(page.assign):
        one = checked(entry, _Assign, where, text, "assign", number, words=WORDS["limits_file"])
        name = limits.known(one.name, line_of(text, where, "assign", number, "class"))
        assign += [(pattern, name) for pattern in ([one.loops] if isinstance(one.loops, str) else one.loops)]
    loops = {}
    for name, entry in page.loops.items():
        if isinstance(entry, dict) and "class" in entry:
            one_class = checked(entry, _OfClass, where, text, "loops", name).name
            loops[name] = classes[limits.known(one_class, line_of(text, where, "loops", name, "class"))]
        else:
            loops[name] = limit(entry, "loops", name)
    return replace(limits, assign=tuple(assign), loops=loops)
