"""By what a loop's input is known again: its files as they stand, its columns in them, its settings, how it is read.

A file is known by its size and the times of its last change (a store's tag for an address), as backup programs do. That
costs one look at the folder per file, nothing per sample: a file that was only touched is read again, one with other
content is never taken for the same.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path

from .places import Remote
from .recipes import Recipe
from .sources import Source

Marks = Mapping[str, str | None]


def mark_of(path: Path | Remote) -> str | None:
    """Return what changes when the content of a file does, None where that cannot be known. Raises OSError."""
    if isinstance(path, Remote):
        version = path.version()
        return version if " " in version else None  # its size alone says too little
    about = path.stat()
    return f"{about.st_size} {about.st_mtime_ns} {about.st_ctime_ns}"


def marks_of(sources: Iterable[Source]) -> dict[str, str | None]:
    """Return the marks of files by their names; to be taken before they are read."""
    found: dict[str, str | None] = {}
    for source in sources:
        try:
            found[str(source.path)] = mark_of(source.path)
        except OSError:
            found[str(source.path)] = None
    return found


def keyed(recipes: Iterable[Recipe], marks: Marks, moment: int | None, salt: str) -> tuple[Recipe, ...]:
    """Return the recipes with the keys of their loops; none for a loop whose files cannot be known again.

    marks: of the files, by name. moment: of --since [microseconds since 1970 UTC]. salt: what else a report depends on.
    """
    recipes = tuple(recipes)
    how = ""
    if recipes:  # which loops are wanted is not how they are read
        how = repr(replace(recipes[0].options, only_loops=(), loops_matching=(), sample=None, sample_seed=0, since=None,
                           share=None))
    return tuple(replace(recipe, key=_key(recipe, marks, (salt, how, moment))) for recipe in recipes)


def _key(recipe: Recipe, marks: Marks, common: tuple[object, ...]) -> str:
    parts = []
    for role, items in sorted(recipe.series.roles.items()):
        for item in items:
            mark = marks.get(item.where)
            if mark is None:
                return ""
            parts.append((role, item.tag, item.loop, item.signal, item.where, mark))
    values = recipe.values
    settings = None if values is None else (dict(values.values), values.where, sorted(values.from_defaults))
    notes = [(note.code, note.message) for note in recipe.notes]
    whole = repr((common, recipe.loop, settings, notes, sorted(recipe.series.missing_tags.items()), parts))
    return hashlib.sha256(whole.encode("utf-8", "backslashreplace")).hexdigest()[:32]
