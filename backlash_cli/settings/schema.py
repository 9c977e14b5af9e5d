"""Loop settings as users write them, a TOML page or a CSV table, checked key by key, and what they mean."""

import csv
import io
import re
from collections.abc import Iterable, Mapping
from dataclasses import field
from functools import cached_property, partial
from typing import Any

from ..errors import MetadataError, nearest
from ..record import Frozen, LoopSettings, Note
from ..toml_text import Page, checked, line_of, parsed, ways_of
from ..words import WORDS, explained, noted
from .pid_forms import RIVALS, number, seconds, to_ideal

ROLE_KEYS = ("sp", "pv", "op", "mode")
LOOP_KEYS = ("K", "Ti", "Td", "Tf", "Kp", "theta", "pv_range", "op_range", *ROLE_KEYS, "form", "PB", "Ki", "Kd",
             "reset", "units", "auto_modes", "description", "limit_class")  # class of dead-band limit
LONGEST, LARGEST, LOOP_GAIN, WIDEST = 30 * 86400.0, 1e9, 50.0, 1e15  # times [s], gains; K Kp of a working loop; spans
_SEPARATOR = re.compile(r"[][\s./\\:_|!-]+")
_NUMBER = r"(-?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)"
_CONSTANT = re.compile(_NUMBER.replace(r"\.", "[.,]"))
_RANGE = re.compile(rf"^\s*[\[(]?\s*{_NUMBER}\s*(?:\.\.\.?|,|;|:|\s|to|bis)\s*{_NUMBER}\s*[\])]?\s*$")


class LoopValues(Frozen):
    """What the metadata say about one loop; `from_defaults` are the keys that come from [defaults]."""

    values: Mapping[str, Any]
    where: str
    from_defaults: frozenset[str] = frozenset()

    @property
    def tags(self) -> dict[str, str]:
        """Return the tags of signals by role, also numbers; sp is one where pv is a tag, else a constant setpoint."""
        named = {role: tag for role in ROLE_KEYS if isinstance(tag := self.values.get(role), (str, int)) and tag != ""}
        return {role: str(tag).strip() for role, tag in named.items() if isinstance(tag, str) or role != "sp"
                or isinstance(named.get("pv"), int)}


class Metadata(Frozen):
    """Settings of all loops of one or several files; `defaults` hold for loops that are not listed."""

    loops: Mapping[str, LoopValues] = field(default_factory=dict)
    defaults: Mapping[str, Any] = field(default_factory=dict)
    files: tuple[str, ...] = ()
    conflicts: tuple[str, ...] = ()

    def part_of(self, loop: str) -> str | None:
        """Return the one loop whose name is a whole part of a longer name in the data (AREA1/FIC101, FIC101_2026)."""
        longer = _spaced(loop)
        inside = [name for name, spaced in self._spaced_names if spaced in longer]
        return inside[0] if len(inside) == 1 and loop not in self.loops else None

    @cached_property
    def _spaced_names(self) -> list[tuple[str, str]]:
        return [(name, _spaced(name)) for name in self.loops if name.strip()]

    def fallback(self) -> LoopValues | None:
        """Return the settings of a loop that is not listed: the defaults alone."""
        return LoopValues(self.defaults, self.files[0], frozenset(self.defaults)) if self.defaults else None

    def match(self, loop: str) -> str | None:
        """Return the name under which the metadata know a loop of the data (FIC-101 as fic101), or None."""
        if loop in self.loops:
            return loop
        same = self._joined_names.get(_joined(_spaced(loop)), [])
        return same[0] if len(same) == 1 else None

    @cached_property
    def _joined_names(self) -> dict[str, list[str]]:
        found: dict[str, list[str]] = {}
        for name, spaced in self._spaced_names:
            found.setdefault(_joined(spaced), []).append(name)
        return found


class _LoopsFile(Page, frozen=True):
    defaults: Mapping[str, Any] = {}
    loops: Mapping[str, Any] = {}


def parse_toml(text: str, where: str) -> Metadata:
    """Read metadata from TOML text. Raises MetadataError naming line and key, with the nearest known ones."""
    page = checked(parsed(text, where), _LoopsFile, where, text, remedy="(settings of a loop stand under [loops.NAME])")
    check_keys(page.defaults, partial(line_of, text, where, "defaults"))
    for name, values in page.loops.items():
        if not isinstance(values, dict):
            raise MetadataError(**explained("no_table", loop=name), where=line_of(text, where, "loops", name))
        check_keys(values, partial(line_of, text, f"{where}, loop {name[:40]}", "loops", name))
    lines = {str(way[1]): f" from line {n} on" for n, way in [*ways_of(text)][::-1] if way[0] == "loops" and way[1:]}
    return with_defaults(page.loops, page.defaults, where, lines)


def parse_table(text: str, where: str) -> Metadata:
    """Read metadata from CSV text with a column `loop`; empty cells are not set, a row `defaults` holds for all.

    Ranges are written "0..900" or "[0, 900]". Raises MetadataError naming line and column."""
    delimiter = max(";\t,", key=text.partition("\n")[0].count)
    reader = csv.reader(io.StringIO(text), delimiter=delimiter, strict=True)
    try:
        rows = [(reader.line_num, row) for row in reader if any(cell.strip() for cell in row)]
    except csv.Error as error:
        raise MetadataError(f"not a CSV table: {error}", where=f"{where}, line {reader.line_num}") from None
    if not rows or rows[0][1][:2] == ["loop", "verdict"]:  # the report of a scan
        return Metadata({}, {}, (where,))
    header = [cell.strip() for cell in rows[0][1]]
    names = [i for word in ("loop", "name", "tag") for i, cell in enumerate(header) if cell.lower() == word]
    twice = next((key for key in header if key and header.count(key) > 1), "")
    if twice or not names:
        raise MetadataError(**explained("column_twice" if twice else "no_loop_column", key=twice), where=where)
    check_keys({key: "" for i, key in enumerate(header) if i != names[0] and key},
               lambda key: f"{where}, line {rows[0][0]}")
    defaults, loops, lines = dict[str, Any](), dict[str, dict[str, Any]](), dict[str, str]()
    for line, row in rows[1:]:
        if "".join(row[len(header) :]).strip():
            raise MetadataError(**explained("long_row", cells=len(row)), where=f"{where}, line {line}")
        cells = dict(zip(header, row, strict=False))
        name = cells.pop(header[names[0]], "").strip()
        values = {key: _value(key, text.strip(), delimiter, f"{where}, line {line}")
                  for key, text in cells.items() if key and text.strip()}
        if {key for key in ("sp", "pv", "op") if _CONSTANT.fullmatch(values.get(key, ""))} == {"sp"}:
            values["sp"] = number(values["sp"], "sp")  # beside tags that are numbers it is one of them
        if name.lower() in ("defaults", "default"):
            defaults = values
        elif not name or name in loops:
            raise MetadataError(f"loop {name!r} is listed twice: leave one out" if name else "row without a loop name",
                                where=f"{where}, line {line}")
        else:
            loops[name], lines[name] = values, f", line {line}"
    return with_defaults(loops, defaults, where, lines)


def _value(key: str, text: str, delimiter: str, where: str) -> Any:
    if key.endswith("_range"):
        text = re.sub(r"(?<=\d),(?=\d)", ".", text) if delimiter == ";" else text
        if (match := _RANGE.match(text)) is None:
            raise MetadataError(f"{key} = {text!r} is not a range", where=where, remedy='write "0..900"')
        return [float(match[1]), float(match[2])]
    return text.split() if key == "auto_modes" else text


def with_defaults(loops: Mapping[str, Mapping[str, Any]], defaults: Mapping[str, Any], where: str,
                  lines: Mapping[str, str]) -> Metadata:
    """Return the settings of a file: of each loop its own and the defaults that hold for it, which are those that it
    does not set, nor contradict by another form of the same. lines: where in it they stand."""
    found = {}
    for name, values in loops.items():
        taken = set(values).union(*(rivals for rivals in RIVALS if set(rivals) & set(values)))
        inherited = {key: value for key, value in defaults.items() if key not in taken}
        found[name] = LoopValues({**inherited, **values}, where + lines.get(name, ""), frozenset(inherited))
    return Metadata(found, defaults, (where,))


def check_keys(values: Mapping[str, Any], line_of: Any) -> None:
    """Raise MetadataError for a key that is not known, with the nearest known ones."""
    for key in values:
        if key not in LOOP_KEYS:
            remedy = WORDS["unknown_settings"].get(key.lower()) or nearest(key, LOOP_KEYS)
            raise MetadataError(f"unknown key {key!r}", where=line_of(key), remedy=remedy)


def merge(parts: Iterable[Metadata]) -> Metadata:
    """Put the metadata of several files together; the first file that sets a loop counts."""
    loops, defaults, files, conflicts = dict[str, LoopValues](), dict[str, Any](), list[str](), list[str]()
    for part in parts:
        files.extend(part.files)
        defaults = {**part.defaults, **defaults}
        for name, values in part.loops.items():
            first = loops.get(name, values)  # "40" in a table is 40.0
            if len({re.sub(r"\.0\b|'", "", str(sorted(one.values.items()))) for one in (first, values)}) > 1:
                conflicts.append(f"{name}: {first.where} and {values.where} differ; the first is used")
            loops.setdefault(name, values)
    return Metadata(loops, defaults, tuple(files), tuple(conflicts))


def _spaced(name: str) -> str:
    return f" {_SEPARATOR.sub(' ', name).strip().lower()} "


def _joined(spaced: str) -> str:
    """A spaced name without blanks, but for those between digits: FIC1-01 is not FIC10-1."""
    return re.sub(r"(?<!\d) | (?!\d)", "", spaced)


class Settings(Frozen):
    """Settings of one loop before the data are seen. loop: K and Kp as given (see `engineering`), times in seconds.
    pv_range, op_range: None when not given. engineering: K and Kp are in output units per measurement unit and back."""

    loop: LoopSettings
    pv_range: tuple[float, float] | None = None
    op_range: tuple[float, float] | None = None
    engineering: bool = False
    auto_modes: tuple[str, ...] = ()
    constant_setpoint: float | None = None
    notes: tuple[Note, ...] = ()


def settings_of(values: LoopValues | None) -> Settings:
    """Check and convert the settings of one loop. Raises MetadataError naming the key, the value and the remedy."""
    if values is None:
        return Settings(LoopSettings())
    try:
        return _settings_of(values)
    except MetadataError as error:
        error.where = error.where or values.where
        raise


def _settings_of(values: LoopValues) -> Settings:
    given = values.values
    (K, Ti, Td), notes = to_ideal(given), tuple[Note, ...]()
    Tf, theta = (seconds(given[key], key) if key in given else None for key in ("Tf", "theta"))
    Kp = number(given["Kp"], "Kp") if "Kp" in given else None
    for key, value in {"Ti": Ti, "Td": Td, "Tf": Tf, "theta": theta}.items():
        if not 0.0 <= (value or 0.0) <= LONGEST:
            raise MetadataError(**explained("no_time", key=key, value=value))
    for key, value in {"K": K, "Kp": Kp}.items():
        if value is not None and not 1.0 / LARGEST <= abs(value) <= LARGEST:
            raise MetadataError(**explained("no_gain" if value else "zero_kp", key=key, value=value))
    odd = [f"{key} = {x:g}" for key, x, most in (("Td", Td, Ti), ("Tf", Tf, Ti), ("Kp", Kp, K and LOOP_GAIN / abs(K)))
           if x and most and abs(x) > most]
    beside = " and ".join(f"{key} = {x:g}{unit}" for key, x, unit in (("K", K, ""), ("Ti", Ti, " s")) if x is not None)
    notes += (noted("settings_doubtful", told=" and ".join(odd), beside=beside),) if odd else ()
    if Kp is not None and K is not None and Kp * K < 0:
        Kp = -Kp
        notes += (Note("kp_sign", f"K and Kp differ in sign, so that one of them is wrong; Kp counts as {Kp:g}"),)
    if (units := str(given.get("units", "normalised")).lower()) not in ("normalised", "normalized", "engineering"):
        raise MetadataError(f"units = {given['units']!r} is not known", remedy='units is "normalised" or "engineering"')
    keys = (("Tf",), ("Kp",), ("theta",), ("pv_range",), ("op_range",), *RIVALS)
    source = {same[0]: "default" if key in values.from_defaults else "metadata"
              for same in keys for key in same if key in given}
    setpoint, modes = given.get("sp"), given.get("auto_modes", ())
    for key, kinds, usual in (("auto_modes", (str, int, float, list, tuple), '["AUTO"]'), (
            "sp", (str, int, float), '"TAG"'), *((role, (str, int), '"TAG"') for role in ROLE_KEYS[1:])):
        if isinstance(value := given.get(key, "-"), bool) or not isinstance(value, kinds) or value == "":
            raise MetadataError(f"{key} may not be {value!r:.60}", remedy=f"write {key} = {usual}")
    loop = LoopSettings(K, Ti, Td, Tf, Kp, theta, source=source)
    return Settings(loop, _range(given, "pv_range"), _range(given, "op_range"), units == "engineering",
                    tuple(map(str, modes if isinstance(modes, (list, tuple)) else [modes])),
                    None if setpoint is None or "sp" in values.tags else number(setpoint, "sp"), notes)


def _range(given: Any, key: str) -> tuple[float, float] | None:
    if (value := given.get(key)) is None:
        return None
    if not isinstance(value, (list, tuple)) or len(value) != 2:
        raise MetadataError(f"{key} must be two numbers, not {value!r}", remedy=f"write {key} = [0, 100]")
    low, high = number(value[0], key), number(value[1], key)
    if not 0.0 < high - low < WIDEST:
        code = "reversed_range" if low > high else "no_span:zero" if low == high else "no_span"
        raise MetadataError(**explained(code, key=key, low=low, high=high))
    return low, high
