"""backlash nightly: the job that cron runs: new exports into the history, reports out of it, old reports away."""

from __future__ import annotations

import contextlib
import json
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import click

from .. import __version__
from ..errors import BacklashError, InputError
from ..reporter.safe import terminal
from .history import read_profile
from .options import Export
from .scan import Job, kept, undated
from .terminal import emit, say, several

if TYPE_CHECKING:
    from ..history.nightly import DatedExport, NightlyConfig
    from ..history.plant import PlantHistory
    from ..history.store import History
    from ..record import Record
    from ..results import ScanResult

LARGEST = 5_000_000  # bytes; a larger log becomes FILE.1 before a run
PULL = "pull"  # rule of its own: a valve has to be pulled

Log = Callable[..., None]


@click.command(short_help="Run the nightly job of a configuration file.",
               epilog="\b\nExample configuration (nightly.toml):\n  inputs = [\"sample_data/plant.csv\"]\n"
               "  history = \"backlash.db\"\n  [outputs]\n  report = \"wear.html\"\n\n\b\nExamples:\n"
               "  backlash nightly nightly.toml\n  backlash nightly nightly.toml --check")
@click.argument("config", metavar="CONFIG.toml", type=click.Path(path_type=Path))
@click.option("--check", is_flag=True, help="Only read the configuration and list the exports that would be scanned.")
def nightly(config: Path, check: bool) -> int:
    """Scan the new exports, add them to the history and write the reports, as a configuration file says.

    Prints one line for the cron mail. Late, missing and repeated exports are named; what is known is not scanned
    again.

    Exit status: 0 done; 1 a fail_on rule was met; 2 wrong use, another job works, or nothing could be read; 3 done,
    but some export or loop could not be analysed.
    """
    from ..history.nightly import missing_dates, read_config

    settings = read_config(config)
    if check:
        found = _exports(settings)
        lines = [f"{e.name}: {', '.join(terminal(path.name) for path in e.files)}" for e in found]
        emit("\n".join([*lines, *(f"{day}: missing" for day in missing_dates(found))]) + "\n")
        return 0
    with open_log(settings.log.file, settings.log.format) as log:
        summary, status = run(settings, log)
    emit(summary + "\n")
    return status


@contextlib.contextmanager
def open_log(path: Path | None, form: str) -> Iterator[Log]:
    """Give a function `log(event, level="info", **values)`; each call is one line.

    Without `path`, lines of text go to standard error (warnings and errors only) and JSON lines to it all.
    """
    with contextlib.ExitStack() as files:
        write: Callable[[str], object] = say
        if path is not None:
            try:
                path.parent.mkdir(parents=True, exist_ok=True)
                if path.exists() and path.stat().st_size > LARGEST:
                    path.replace(path.with_name(path.name + ".1"))
                stream = files.enter_context(path.open("a", 1, encoding="utf-8", errors="backslashreplace"))
            except OSError as error:
                raise BacklashError(f"cannot write the log: {error.strerror}", where=str(path), code="cannot_write",
                                    remedy="check `log.file` in the configuration") from None
            write = lambda line: stream.write(line + "\n")  # noqa: E731

        def log(event: str, level: str = "info", **values: object) -> None:
            now = datetime.now(UTC).isoformat(timespec="seconds").replace("+00:00", "Z")
            words = terminal(" ".join([event, *(f"{k}={v}" for k, v in values.items() if v not in ("", ()))]))
            if form == "json":
                write(json.dumps({"time": now, "level": level, "event": event, **values}, ensure_ascii=False,
                                 default=str))
            elif path is not None:
                write(f"{now} {level} {words}")
            elif level != "info":
                write(words)

        yield log


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
    from ..history.nightly import lock, missing_dates
    from ..history.plant import plant_history
    from ..history.store import History
    from ..reporter.scan_report import met, parse_rules

    limits = read_profile(config.limits, config.loops)
    rules = parse_rules((rule for rule in config.fail_on if rule != PULL), f"{config.path}, fail_on")
    with lock(config.lock) as stale:
        if stale:
            log(stale, "warning")
        found = _exports(config)
        night = Night(missing=missing_dates(found))
        with History(config.history, create=True, say=lambda text: log(text, "warning")) as store:
            _scan_all(config, found, store, night, log)
            if night.failed and not (night.scanned or night.known):
                raise InputError(f"none of {len(found)} exports could be read", where=str(config.path),
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


def _exports(config: NightlyConfig) -> list[DatedExport]:
    from ..history.nightly import find_exports

    found = find_exports(config.inputs, together=config.together, look_back=config.look_back)
    if not found:
        raise InputError("no export fits the patterns", where=f"{config.path}, inputs",
                         remedy=f"check them: {', '.join(config.inputs)}")
    return found


def _scan_all(config: NightlyConfig, found: Sequence[DatedExport], store: History, night: Night, log: Log) -> None:
    from ..loaders import ReadOptions
    from ..loaders.sources import find_sidecars, find_sources
    from ..scanning import ScanOptions

    def lost(export: DatedExport, reason: str) -> None:
        night.failed.append(export.name)
        log("failed", "error", night=export.name, reason=reason)

    keys = {export.name: f"{config.path.stem}:{export.name}" for export in found}
    newest = max((e.date for e in found if e.date and store.export_fingerprint(keys[e.name])), default=None)
    for export in found:
        key = keys[export.name]
        try:
            settings = [config.loops] if config.loops else find_sidecars(export.files, find_sources(export.files))
            fingerprint = export.fingerprint([Path(path) for path in settings], salt=__version__)
        except OSError as error:
            lost(export, error.strerror or str(error))
            continue
        if store.export_fingerprint(key) == fingerprint:
            night.known.append(export.name)
            log("known", night=export.name)
            continue
        job = Job(Export(export.files, config.loops, ReadOptions(**config.reading)), ScanOptions(carry=True),
                  config.jobs, shown=False)
        # what a job that was killed had finished of this night is taken over
        with kept(config.history, (key, job.export.reading, job.options), resume=True) as job.keep:
            try:
                scan = job.scan()
            except BacklashError as error:
                lost(export, str(error))
                continue
            outcome = store.add_all([undated(scan)], export=(key, fingerprint))
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


def _write_scan(pattern: str, keep: int, name: str, result: ScanResult, records: Mapping[str, Record],
                log: Log) -> None:
    """Write the report of one night and remove the oldest ones beyond `keep`."""
    from ..history.nightly import expand, matches
    from ..reporter.scan_report import check_delivery, write

    target = Path(expand(pattern, name))
    target.parent.mkdir(parents=True, exist_ok=True)
    write(result, records, check_delivery(None, target, "loops") or "table", target, "loops")
    dated = sorted((day, path) for path, day in matches(pattern) if day is not None)
    for _, path in dated[: max(len(dated) - keep, 0)]:
        path.unlink(missing_ok=True)
        log("removed", report=path.name)


def _write_reports(config: NightlyConfig, plant: PlantHistory, store: History, log: Log) -> None:
    from ..reporter.files import write_text
    from ..reporter.history_report import trend, write_report

    if config.outputs.report is not None:
        config.outputs.report.parent.mkdir(parents=True, exist_ok=True)
        write_report(config.outputs.report, plant.places, plant.wears, plant.nights, store.recent_half_periods)
        log("report", path=str(config.outputs.report))
    if config.outputs.trend is not None:
        config.outputs.trend.parent.mkdir(parents=True, exist_ok=True)
        write_text(config.outputs.trend, trend(plant.wears, plant.places).json())


def _summary(config: NightlyConfig, night: Night, plant: PlantHistory, hits: Sequence[str]) -> str:
    """Return the line for the cron mail."""
    from ..results.history import day_of

    last = max((n.end for found in plant.nights.values() for n in found), default=None)
    day = day_of(last).isoformat() if last is not None else "no data"
    counts = ", ".join(f"{n} {word}" for word in ("new", "revised", "known") if (n := night.nights[word])) or "none"
    parts = [f"backlash {day}: {several(len(plant.places), 'loop')}",
             f"scanned {_names(night.scanned)} (loop nights: {counts})" if night.scanned
             else f"nothing new ({len(night.known)} known)"]
    actions = {words: [p.loop for p in plant.places if p.action == action]
               for action, words in (("pull", "pull"), ("room", "pull if room"), ("watch", "watch"))}
    said = {**actions, "late": night.late, "missing": night.missing, "failed": night.failed, "alarm": hits}
    parts += [f"{words} {_names(names)}" for words, names in said.items() if names]
    if config.outputs.report is not None:
        parts.append(f"report {config.outputs.report}")
    return terminal("; ".join(parts))


def _names(names: Sequence[str], most: int = 5) -> str:
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")
