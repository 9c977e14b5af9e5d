"""The configuration of the nightly job: one TOML file, checked key by key; paths are relative to it."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..errors import MetadataError, nearest

KEYS: dict[str, tuple[str, ...]] = {  # by table; "" is the page itself
    "": ("inputs", "loops", "history", "limits", "horizon", "fail_on", "together", "look_back", "lock", "outputs",
         "log", "reading", "jobs"),
    "outputs": ("report", "scan", "trend", "keep"),
    "log": ("file", "format"),
    "reading": ("time_format", "timezone", "interpolation", "delimiter", "decimal", "encoding", "layout", "columns",
                "header_row", "only_loops", "good_quality", "auto_modes"),
}
SCAN_SUFFIXES = (".html", ".json", ".csv", ".parquet")


@dataclass(frozen=True)
class NightlyConfig:
    """What the nightly job does.

    inputs: patterns of exports; `{date}` or `{date:%Y%m%d}` stands for the day, `*` and `?` for any characters.
    together: exports without a date are one plant, not one night each. look_back: days before the newest export that
    are looked at. history, lock: files. report: .html file or folder; scan: report of each night, `{date}` in its
    name; trend: JSON file; keep: how many scan reports stay. log_file: None is standard error; log_format: text or
    json. reading: options of how to read exports.
    """

    path: Path
    inputs: tuple[str, ...]
    history: Path
    lock: Path
    loops: Path | None = None
    limits: Path | None = None
    horizon: float = 90.0
    fail_on: tuple[str, ...] = ()
    together: bool = False
    look_back: int = 14
    report: Path | None = None
    scan: str | None = None
    trend: Path | None = None
    keep: int = 30
    log_file: Path | None = None
    log_format: str = "text"
    jobs: int | None = None
    reading: Mapping[str, Any] = field(default_factory=dict)


def read_config(path: str | Path) -> NightlyConfig:
    """Read the configuration of the nightly job.

    Raises MetadataError naming the file, the key, and the remedy.
    """
    path = Path(path)
    try:
        document = tomllib.loads(path.read_text("utf-8-sig"))
    except (OSError, UnicodeDecodeError) as error:
        raise MetadataError(f"cannot read the configuration: {getattr(error, 'strerror', None) or 'not UTF-8 text'}",
                            where=str(path), remedy="check the path; docs/nightly.md shows an example") from None
    except tomllib.TOMLDecodeError as error:
        raise MetadataError(f"invalid TOML syntax: {error}", where=str(path), remedy="mend that line") from None
    return _Checker(path, document).config()


class _Checker:
    """Takes values out of the document one by one and says what is wrong with them; keys are "table.key" or "key"."""

    def __init__(self, path: Path, document: dict[str, Any]) -> None:
        self.path, self.document = path, document

    def config(self) -> NightlyConfig:
        for name, keys in KEYS.items():
            table = self._take(name, dict, {}) if name else self.document
            for key in table:
                if key not in keys:
                    raise self._wrong(f"{name}.{key}".strip("."), "unknown key", nearest(key, keys))
        folder, inputs, history = self.path.parent, self._texts("inputs"), self._file("history")
        scan = self._take("outputs.scan", str, None)
        if not inputs:
            raise self._wrong("inputs", "no inputs are given", 'for example inputs = ["exports/plant_{date}.csv"]')
        if history is None:
            raise self._wrong("history", "no history is given", 'for example history = "backlash.db"')
        if scan is not None and "{date" not in scan:
            raise self._wrong("outputs.scan", "the name of a night's report needs its date",
                              'for example scan = "scans/{date}.html"')
        if scan is not None and Path(scan).suffix.lower() not in SCAN_SUFFIXES:
            raise self._wrong("outputs.scan", f"no report with the ending {Path(scan).suffix!r}",
                              f"one of: {', '.join(SCAN_SUFFIXES)}")
        log_format = self._take("log.format", str, "text")
        if log_format not in ("text", "json"):
            raise self._wrong("log.format", f"no log format {log_format!r}", "one of: text, json")
        reading = {key: tuple(value) if isinstance(value, list) else value
                   for key, value in self.document.get("reading", {}).items()}
        return NightlyConfig(
            self.path, tuple(str(folder / pattern) for pattern in inputs), history,
            self._file("lock") or history.with_name(history.name + ".lock"), self._file("loops"),
            self._file("limits"), self._number("horizon", 90.0), self._texts("fail_on"),
            self._take("together", bool, False), int(self._number("look_back", 14)), self._file("outputs.report"),
            None if scan is None else str(folder / scan), self._file("outputs.trend"),
            int(self._number("outputs.keep", 30)), self._file("log.file"), log_format,
            int(self._number("jobs", 1)) if "jobs" in self.document else None, reading)

    def _texts(self, key: str) -> tuple[str, ...]:
        value = self._value(key, [])
        value = [value] if isinstance(value, str) else value
        if not isinstance(value, list) or not all(isinstance(item, str) for item in value):
            raise self._wrong(key, "must be a text or a list of texts", f'for example {key} = ["..."]')
        return tuple(value)

    def _file(self, key: str) -> Path | None:
        value = self._take(key, str, None)
        return None if value is None else self.path.parent / value

    def _number(self, key: str, default: float) -> float:
        value = self._value(key, default)
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0 < value < 1e6:
            raise self._wrong(key, f"must be a positive number, not {value!r}", f"for example {default:g}")
        return float(value)

    def _take(self, key: str, kind: type, default: Any) -> Any:
        value = self._value(key, default)
        if value is not None and not isinstance(value, kind):
            names = {dict: "a table", str: "a text in quotes", bool: "true or false"}
            raise self._wrong(key, f"must be {names[kind]}, not {value!r}", "docs/nightly.md shows an example")
        return value

    def _value(self, key: str, default: Any) -> Any:
        table, _, name = key.rpartition(".")
        return (self.document.get(table, {}) if table else self.document).get(name, default)

    def _wrong(self, key: str, what: str, remedy: str) -> MetadataError:
        return MetadataError(what, where=f"{self.path}, {key}", remedy=remedy)
