"""Loop settings as a CSV table: one row per loop, the keys of `loops.toml` as columns."""

from __future__ import annotations

import csv
import io
import re
from typing import Any

from ..errors import MetadataError, nearest
from .schema import LOOP_KEYS, LoopValues, Metadata

_RANGE = re.compile(r"^\s*[\[(]?\s*(-?[\d.]+(?:[eE][+-]?\d+)?)\s*(?:\.\.\.?|,|;|:|\s|to|bis)\s*"
                    r"(-?[\d.]+(?:[eE][+-]?\d+)?)\s*[\])]?\s*$")  # fmt: skip


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
    for i, key in enumerate(header):
        if i != names[0] and key and key not in LOOP_KEYS:
            raise MetadataError(
                f"unknown column {key!r}", where=f"{where}, line {rows[0][0]}", remedy=nearest(key, LOOP_KEYS)
            )
    defaults: dict[str, Any] = {}
    loops: dict[str, LoopValues] = {}
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
            inherited = {k: v for k, v in defaults.items() if k not in values}
            loops[name] = LoopValues({**inherited, **values}, where, frozenset(inherited))
    return Metadata(loops, defaults, (where,))


def _value(key: str, text: str, delimiter: str, where: str) -> Any:
    text = text.strip()
    if key.endswith("_range"):
        if delimiter == ";":
            text = re.sub(r"(?<=\d),(?=\d)", ".", text)
        match = _RANGE.match(text)
        if match is None:
            raise MetadataError(f"{key} = {text!r} is not a range", where=where, remedy='write "0..900"')
        try:
            return [float(match[1]), float(match[2])]
        except ValueError:
            raise MetadataError(f"{key} = {text!r} is not a range", where=where, remedy='write "0..900"') from None
    if key == "auto_modes":
        return text.split()
    return text
