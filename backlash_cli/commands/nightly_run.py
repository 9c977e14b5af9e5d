"""One nightly run: new exports into the history, reports out of it, old reports away; and its log."""

from __future__ import annotations

import contextlib
import json
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path

from .. import __version__
from ..errors import BacklashError, InputError
from ..history.nightly import Export, NightlyConfig, expand, find_exports, lock, matches, missing_dates
from ..history.plant import PlantHistory, plant_history
from ..history.store import History
from ..record import Record
from ..reporter.safe import terminal
from ..results import ScanResult
from ..results.history import day_of
from .history_options import read_profile
from .run_scan import Job, kept, undated

LARGEST = 5_000_000  # bytes; a larger log becomes FILE.1 before a run

Log = Callable[..., None]
PULL = "pull"  # rule of its own: a valve has to be pulled


@contextlib.contextmanager
def open_log(path: Path | None, form: str, say: Callable[[str], None]) -> Iterator[Log]:
    """Give a function `log(event, level="info", **values)`; each call is one line.

    Without `path`, lines of text go to `say` (warnings and errors only) and JSON lines to it all.
    """
    if path is None:
        yield lambda event, level="info", **values: (
            say(json_line(event, level, values) if form == "json" else words(event, values))
            if form == "json" or level != "info" else None)
        return
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.exists() and path.stat().st_size > LARGEST:
            path.replace(path.with_name(path.name + ".1"))
        stream = path.open("a", encoding="utf-8", errors="backslashreplace")
    except OSError as error:
        raise BacklashError(f"cannot write the log: {error.strerror}", where=str(path), code="cannot_write",
                            remedy="check `log.file` in the configuration") from None
    with stream:
        def log(event: str, level: str = "info", **values: object) -> None:
            line = json_line(event, level, values) if form == "json" else f"{now()} {level} {words(event, values)}"
            stream.write(line + "\n")
            stream.flush()

        yield log


def words(event: str, values: dict[str, object]) -> str:
    """Return an event as a line of text."""
    return terminal(" ".join([event, *(f"{key}={value}" for key, value in values.items() if value not in ("", ()))]))


def json_line(event: str, level: str, values: dict[str, object]) -> str:
    """Return an event as one line of JSON."""
    return json.dumps({"time": now(), "level": level, "event": event, **values}, ensure_ascii=False, default=str)


def now() -> str:
    """Clock time in UTC; only the log knows it."""
    return datetime.now(UTC).isoformat(timespec="seconds").replace("+00:00", "Z")


@dataclass
class Night:
    """What happened to the exports of a run, by name."""

    scanned: list[str] = field(default_factory=list)
    known: list[str] = field(default_factory=list)
    late: list[str] = field(default_factory=list)
    failed: list[str] = field(default_factory=list)
    missing: list[str] = field(default_factory=list)
    nights: Counter[str] = field(default_factory=Counter)
    newest: ScanResult | None = None
    incomplete: bool = False


def run(config: NightlyConfig, log: Log) -> tuple[str, int]:
    """Do one run and return its summary line and exit status.

    Raises BacklashError when nothing can be done: wrong configuration, another job, no export that can be read.
    """
    from ..reporter.rules import met, parse_rules

    limits = read_profile(config.limits, config.loops)
    rules = parse_rules((rule for rule in config.fail_on if rule != PULL), f"{config.path}, fail_on")
    with lock(config.lock) as stale:
        if stale:
            log(stale, "warning")
        exports = _exports(config)
        night = Night(missing=missing_dates(exports))
        with History(config.history, create=True, say=lambda text: log(text, "warning")) as store:
            _scan_all(config, exports, store, night, log)
            if night.failed and not (night.scanned or night.known):
                raise InputError(f"none of {len(exports)} exports could be read", where=str(config.path),
                                 remedy="see the log for the reason of each")
            plant = plant_history(store, limits, horizon=config.horizon)
            _write_reports(config, plant, store, log)
    for day in night.missing:
        log("missing", "warning", night=day)
    hits = met(rules, night.newest.loops) if night.newest else []
    if PULL in config.fail_on:
        hits += [p.loop for p in plant.places if p.action == PULL]
    summary = _summary(config, night, plant, sorted(set(hits)))
    log("done", summary=summary)
    return summary, 1 if hits else 3 if night.failed or night.incomplete else 0


def list_exports(config: NightlyConfig) -> str:
    """Say what a run would scan."""
    exports = _exports(config)
    lines = [f"{e.name}: {', '.join(terminal(path.name) for path in e.files)}" for e in exports]
    return "\n".join([*lines, *(f"{day}: missing" for day in missing_dates(exports))]) + "\n"


def _exports(config: NightlyConfig) -> list[Export]:
    exports = find_exports(config.inputs, together=config.together, look_back=config.look_back)
    if not exports:
        raise InputError("no export fits the patterns", where=f"{config.path}, inputs",
                         remedy=f"check them: {', '.join(config.inputs)}")
    return exports


def _scan_all(config: NightlyConfig, exports: Sequence[Export], store: History, night: Night, log: Log) -> None:
    from ..loaders.sources import find_sidecars, find_sources

    newest = max((e.date for e in exports if e.date and store.export_fingerprint(_key(config, e))), default=None)
    for export in exports:
        try:
            found = [config.loops] if config.loops else find_sidecars(export.files, find_sources(export.files))
            fingerprint = export.fingerprint([Path(path) for path in found], salt=__version__)
        except OSError as error:
            night.failed.append(export.name)
            log("failed", "error", night=export.name, reason=error.strerror or str(error))
            continue
        if store.export_fingerprint(_key(config, export)) == fingerprint:
            night.known.append(export.name)
            log("known", night=export.name)
            continue
        job = _job(config, export)
        # what a job that was killed had finished of this night is taken over
        with kept(config.history, (_key(config, export), job.reading, job.options), resume=True) as job.keep:
            try:
                scan = job.scan()
            except BacklashError as error:
                night.failed.append(export.name)
                log("failed", "error", night=export.name, reason=str(error))
                continue
            outcome = store.add_all([undated(scan)], export=(_key(config, export), fingerprint))
        if job.taken_over:
            log("resumed", night=export.name, loops=job.taken_over)
        if newest is not None and export.date is not None and export.date < newest:
            night.late.append(export.name)
        night.scanned.append(export.name)
        night.nights.update(new=len(outcome.new), revised=len(outcome.revised), known=len(outcome.unchanged))
        night.newest = scan
        night.incomplete |= bool(scan.failures) or any(r.verdict == "error" for r in scan.loops)
        log("scanned", night=export.name, loops=len(scan.loops), history=outcome.sentence(),
            late=export.name in night.late)
        for note in scan.failures:
            log("not analysed", "warning", night=export.name, reason=note.message)
        if config.outputs.scan is not None:
            _write_scan(config.outputs.scan, config.outputs.keep, export.name, scan, job.records, log)


def _key(config: NightlyConfig, export: Export) -> str:
    return f"{config.path.stem}:{export.name}"


def _job(config: NightlyConfig, export: Export) -> Job:
    from ..loaders import ReadOptions
    from ..scanning import ScanOptions

    return Job(export.files, config.loops, ReadOptions(**config.reading), ScanOptions(carry=True), config.jobs,
               shown=False)


def _write_scan(pattern: str, keep: int, name: str, result: ScanResult, records: Mapping[str, Record],
                log: Log) -> None:
    """Write the report of one night and remove the oldest ones beyond `keep`."""
    from ..reporter.delivery import check_delivery, write

    target = Path(expand(pattern, name))
    form = check_delivery(None, target, "loops") or "table"
    target.parent.mkdir(parents=True, exist_ok=True)
    write(result, records, form, target, "loops")
    dated = sorted((day, path) for path, day in matches(pattern) if day is not None)
    for _, path in dated[: max(len(dated) - keep, 0)]:
        path.unlink(missing_ok=True)
        log("removed", report=path.name)


def _write_reports(config: NightlyConfig, plant: PlantHistory, store: History, log: Log) -> None:
    from ..reporter.files import write_text
    from ..reporter.history_page import write_report
    from ..reporter.history_text import trend_json

    if config.outputs.report is not None:
        config.outputs.report.parent.mkdir(parents=True, exist_ok=True)
        write_report(config.outputs.report, plant.places, plant.wears, plant.nights, store.recent_half_periods)
        log("report", path=str(config.outputs.report))
    if config.outputs.trend is not None:
        config.outputs.trend.parent.mkdir(parents=True, exist_ok=True)
        write_text(config.outputs.trend, trend_json(plant.wears, plant.places))


def _summary(config: NightlyConfig, night: Night, plant: PlantHistory, hits: Sequence[str]) -> str:
    """Return the line for the cron mail."""
    last = max((n.end for found in plant.nights.values() for n in found), default=None)
    loops = len(plant.places)
    day = day_of(last).isoformat() if last is not None else "no data"
    parts = [f"backlash {day}: {loops} loop{'s' * (loops != 1)}"]
    parts.append(f"scanned {_names(night.scanned)} ({_counts(night)})" if night.scanned
                 else f"nothing new ({len(night.known)} known)")
    for action, words in (("pull", "pull"), ("room", "pull if room"), ("watch", "watch")):
        named = [p.loop for p in plant.places if p.action == action]
        if named:
            parts.append(f"{words} {_names(named)}")
    for words, names in (("late", night.late), ("missing", night.missing), ("failed", night.failed), ("alarm", hits)):
        if names:
            parts.append(f"{words} {_names(names)}")
    if config.outputs.report is not None:
        parts.append(f"report {config.outputs.report}")
    return terminal("; ".join(parts))


def _counts(night: Night) -> str:
    """Say how many nights of single loops are new, revised or known."""
    found = [f"{n} {word}" for word in ("new", "revised", "known") if (n := night.nights[word])]
    return "loop nights: " + (", ".join(found) or "none")


def _names(names: Sequence[str], most: int = 5) -> str:
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")
