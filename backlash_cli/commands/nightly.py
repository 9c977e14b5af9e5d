"""backlash nightly: the job that cron runs: new exports into the history, reports out of it, old reports away."""

from __future__ import annotations

import contextlib
import json
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from .. import __version__
from ..errors import BacklashError, InputError
from ..reporter.safe import terminal
from .history import read_profile
from .options import Export, command
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


@command
def nightly(config: Path, check: bool) -> int:
    """Scan the new exports, add them to the history and write the reports, as a configuration file says."""
    from ..history.nightly import read_config
    from ..results.history import missing_days

    settings = read_config(config)
    if check:
        found = _exports(settings)
        lines = [f"{e.name}: {', '.join(terminal(path.name) for path in e.files)}" for e in found]
        emit("\n".join([*lines, *(f"{day}: missing" for day in missing_days(e.date for e in found if e.date))]) + "\n")
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
    stream = None
    if path is not None:
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            if path.exists() and path.stat().st_size > LARGEST:
                path.replace(path.with_name(path.name + ".1"))
            stream = path.open("a", 1, encoding="utf-8", errors="backslashreplace")
        except OSError as error:
            raise BacklashError(f"cannot write the log: {error.strerror}", where=str(path), code="cannot_write",
                                remedy="check `log.file` in the configuration") from None

    def log(event: str, level: str = "info", **values: object) -> None:
        now = datetime.now(UTC).isoformat(timespec="seconds").replace("+00:00", "Z")
        line = terminal(" ".join([event, *(f"{k}={v}" for k, v in values.items() if v not in ("", ()))]))
        if form == "json":
            line = json.dumps({"time": now, "level": level, "event": event, **values}, ensure_ascii=False, default=str)
        elif stream is not None:
            line = f"{now} {level} {line}"
        elif level == "info":
            return
        say(line) if stream is None else stream.write(line + "\n")

    with stream or contextlib.nullcontext():
        yield log


def run(config: NightlyConfig, log: Log) -> tuple[str, int]:
    """Do one run and return its summary line and exit status.

    Raises BacklashError when nothing can be done: wrong configuration, another job, no export that can be read.
    """
    from ..history.nightly import lock
    from ..history.plant import plant_history
    from ..history.store import History
    from ..reporter.files import write_text
    from ..reporter.history_report import trend, write_report
    from ..reporter.scan_report import met, parse_rules
    from ..results.history import missing_days

    limits = read_profile(config.limits, config.loops)
    rules = parse_rules((rule for rule in config.fail_on if rule != PULL), f"{config.path}, fail_on")
    report, numbers = config.outputs.report, config.outputs.trend
    with lock(config.lock) as stale:
        if stale:
            log(stale, "warning")
        found = _exports(config)
        with History(config.history, create=True, say=lambda text: log(text, "warning")) as store:
            names, counts, newest = _scan_all(config, found, store, log)
            if not names["scanned"] + names["known"]:
                raise InputError(f"none of {len(found)} exports could be read", where=str(config.path),
                                 remedy="see the log for the reason of each")
            plant = plant_history(store, limits, horizon=config.horizon)
            for path in filter(None, (report, numbers)):
                path.parent.mkdir(parents=True, exist_ok=True)
            if report is not None:
                write_report(report, plant.places, plant.wears, plant.nights, store.recent_half_periods)
                log("report", path=str(report))
            if numbers is not None:
                write_text(numbers, trend(plant.wears, plant.places).json())
    names["missing"] = missing_days(e.date for e in found if e.date)
    for day in names["missing"]:
        log("missing", "warning", night=day)
    hits = met(rules, newest.loops) if newest else []
    if PULL in config.fail_on:
        hits += [p.loop for p in plant.places if p.action == PULL]
    summary = _summary(config, names, counts, plant, sorted(set(hits)))
    log("done", summary=summary)
    return summary, 1 if hits else 3 if names["failed"] or names["incomplete"] else 0


def _exports(config: NightlyConfig) -> list[DatedExport]:
    from ..history.nightly import find_exports

    found = find_exports(config.inputs, together=config.together, look_back=config.look_back)
    if not found:
        raise InputError("no export fits the patterns", where=f"{config.path}, inputs",
                         remedy=f"check them: {', '.join(config.inputs)}")
    return found


def _scan_all(config: NightlyConfig, found: Sequence[DatedExport], store: History, log: Log
              ) -> tuple[dict[str, list[str]], Counter[str], ScanResult | None]:
    """Scan what is new into the history.

    Returns the names of the exports by what happened to them, the loop nights counted in the same way, and the last
    scan.
    """
    from ..loaders import ReadOptions
    from ..loaders.sources import find_sidecars, find_sources
    from ..scanning import ScanOptions

    def lost(reason: str) -> None:
        names["failed"].append(export.name)
        log("failed", "error", night=export.name, reason=reason)

    names: dict[str, list[str]] = defaultdict(list)
    counts: Counter[str] = Counter()
    scan: ScanResult | None = None
    known = {export.name: store.export_fingerprint(f"{config.path.stem}:{export.name}") for export in found}
    newest = max((e.date for e in found if e.date and known[e.name]), default=None)
    for export in found:
        key = f"{config.path.stem}:{export.name}"
        try:
            settings = [config.loops] if config.loops else find_sidecars(export.files, find_sources(export.files))
            fingerprint = export.fingerprint([Path(path) for path in settings], salt=__version__)
        except OSError as error:
            lost(error.strerror or str(error))
            continue
        if known[export.name] == fingerprint:
            names["known"].append(export.name)
            log("known", night=export.name)
            continue
        job = Job(Export(export.files, config.loops, ReadOptions(**config.reading)), ScanOptions(carry=True),
                  config.jobs, shown=False)
        # what a job that was killed had finished of this night is taken over
        with kept(config.history, (key, job.export.reading, job.options), resume=True) as job.keep:
            try:
                scan = job.scan()
            except BacklashError as error:
                lost(str(error))
                continue
            outcome = store.add(undated(scan), export=(key, fingerprint))
        if job.taken_over:
            log("resumed", night=export.name, loops=job.taken_over)
        late = newest is not None and export.date is not None and export.date < newest
        wrong = bool(scan.failures) or any(r.verdict == "error" for r in scan.loops)
        for word, holds in (("scanned", True), ("late", late), ("incomplete", wrong)):
            names[word] += [export.name] * holds
        counts.update(new=len(outcome.new), revised=len(outcome.revised), known=len(outcome.unchanged))
        log("scanned", night=export.name, loops=len(scan.loops), history=outcome.sentence(), late=late)
        for note in scan.failures:
            log("not analysed", "warning", night=export.name, reason=note.message)
        if config.outputs.scan is not None:
            _write_scan(config.outputs.scan, config.outputs.keep, export.name, scan, job.plant, log)
    return names, counts, scan


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


def _summary(config: NightlyConfig, names: Mapping[str, Sequence[str]], counts: Counter[str], plant: PlantHistory,
             hits: Sequence[str]) -> str:
    """Return the line for the cron mail."""
    from ..results.history import day_of

    last = max((n.end for found in plant.nights.values() for n in found), default=None)
    day = day_of(last).isoformat() if last is not None else "no data"
    counted = ", ".join(f"{n} {word}" for word, n in counts.items() if n) or "none"
    parts = [f"backlash {day}: {several(len(plant.places), 'loop')}",
             f"scanned {_names(names['scanned'])} (loop nights: {counted})" if names["scanned"]
             else f"nothing new ({len(names['known'])} known)"]
    actions = {words: [p.loop for p in plant.places if p.action == action]
               for action, words in (("pull", "pull"), ("room", "pull if room"), ("watch", "watch"))}
    said = {**actions, **{word: names[word] for word in ("late", "missing", "failed")}, "alarm": hits}
    parts += [f"{words} {_names(found)}" for words, found in said.items() if found]
    if config.outputs.report is not None:
        parts.append(f"report {config.outputs.report}")
    return terminal("; ".join(parts))


def _names(names: Sequence[str]) -> str:
    return ", ".join(names[:5]) + (f" and {len(names) - 5} more" if len(names) > 5 else "")
