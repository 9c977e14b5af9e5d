"""Loop settings as a TOML page or as a CSV table, checked key by key; what is wrong is named with its line."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Mapping
from functools import partial
from typing import Any

from ..errors import MetadataError
from ..toml_text import Page, checked, line_of, parsed
from .schema import Metadata, check_keys, with_defaults

_NUMBER = r"(-?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)"
_RANGE = re.compile(rf"^\s*[\[(]?\s*{_NUMBER}\s*(?:\.\.\.?|,|;|:|\s|to|bis)\s*{_NUMBER}\s*[\])]?\s*$")


class _LoopsFile(Page, frozen=True):
    defaults: Mapping[str, Any] = {}
    loops: Mapping[str, Any] = {}


def parse_toml(text: str, where: str) -> Metadata:
    """Read metadata from TOML text. Raises MetadataError naming line and key, with the nearest known ones."""
    page = checked(parsed(text, where), _LoopsFile, where, text,
                   remedy="settings of a loop stand under [loops.NAME] of the loops file")
    check_keys(page.defaults, partial(line_of, text, where, "defaults"))
    for name, values in page.loops.items():
        if not isinstance(values, dict):
            raise MetadataError(f"'loops.{name}' must be a table", where=line_of(text, where, "loops", name),
                                remedy=f"write it as [loops.{name}] with keys below")
        check_keys(values, partial(line_of, text, where, "loops", name))
    return with_defaults(page.loops, page.defaults, where)


def parse_table(text: str, where: str) -> Metadata:
    """Read metadata from CSV text with a column `loop`; empty cells are not set, a row `defaults` holds for all.

    Ranges are written "0..900" or "[0, 900]". Raises MetadataError naming line and column.
    """
    head = text.partition("\n")[0]
    delimiter = max(";\t,", key=head.count)
    reader = csv.reader(io.StringIO(text), delimiter=delimiter)
    try:
        rows = [(reader.line_num, row) for row in reader if any(cell.strip() for cell in row)]
    except csv.Error as error:
        raise MetadataError(f"not a CSV table: {error}", where=f"{where}, line {reader.line_num}") from None
    if not rows:
        return Metadata({}, {}, (where,))
    header = [cell.strip() for cell in rows[0][1]]
    names = [i for i, cell in enumerate(header) if cell.lower() in ("loop", "name", "tag")]
    if not names:
        raise MetadataError("table has no column 'loop'", where=where, remedy="name the loops in a column called loop")
    check_keys({key: "" for i, key in enumerate(header) if i != names[0] and key},
               lambda key: f"{where}, line {rows[0][0]}")
    defaults: dict[str, Any] = {}
    loops: dict[str, dict[str, Any]] = {}
    for line, row in rows[1:]:
        cells = dict(zip(header, row, strict=False))
        name = cells.pop(header[names[0]], "").strip()
        values = {k: _value(k, v, delimiter, f"{where}, line {line}") for k, v in cells.items() if k and v.strip()}
        if name.lower() in ("defaults", "default"):
            defaults = values
        elif not name or name in loops:
            raise MetadataError(f"loop {name!r} is listed twice" if name else "row without a loop name",
                                where=f"{where}, line {line}")
        else:
            loops[name] = values
    return with_defaults(loops, defaults, where)


def _value(key: str, text: str, delimiter: str, where: str) -> Any:
    text = text.strip()
    if key.endswith("_range"):
        if delimiter == ";":
            text = re.sub(r"(?<=\d),(?=\d)", ".", text)
        match = _RANGE.match(text)
        if match is None:
            raise MetadataError(f"{key} = {text!r} is not a range", where=where, remedy='write "0..900"')
        return [float(match[1]), float(match[2])]
    return text.split() if key == "auto_modes" else text
