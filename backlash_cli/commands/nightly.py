"""backlash nightly: the job that cron runs: new exports into the history, reports out of it, old reports away."""

import contextlib
import json
import sys
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from .. import __version__
from ..errors import BacklashError, InputError, some
from ..history.nightly import DatedExport, NightlyConfig, check_places, expand, find_exports, lock, matches, read_config
from ..history.plant import plant_history
from ..history.store import History
from ..loaders import ReadOptions
from ..loaders.sources import find_sidecars, find_sources
from ..record import Record
from ..reporter.files import make_folder, write_text
from ..reporter.history_report import trend, write_report
from ..reporter.safe import counted, terminal
from ..reporter.scan_report import check_delivery, met, parse_rules, write
from ..reporter.templates import sentence
from ..reporter.words import TO_DO, day
from ..results import ScanResult
from ..results.history import Place, gone, missing_days
from ..scanning import ScanOptions
from .history import read_profile
from .options import Export
from .scan import Job, kept, lost
from .terminal import emit, refusal, say

LARGEST = 5_000_000  # bytes; a larger log becomes FILE.1 before a run
PULL = "pull"  # rule of its own: a valve has to be pulled
OLDER, NOTHING = "older than look_back", "no export found"  # and not in the history; for one of several inputs
GONE, REPEATED, REVISED = "no longer there", "nothing new in", "revised by"  # loops; exports; another one of a night
DAMAGE = ("ragged_rows", "truncated", "passed_over", "no_tag")  # parts of an export that are lost
INCOMPLETE = "incomplete"  # a part could not be read: before the fingerprint of the export, to be told each time
SAID = (OLDER, "missing", NOTHING, "misdated", REPEATED, REVISED, INCOMPLETE, GONE)

Log = Callable[..., None]
Done = dict[str, list[Any]]  # names of exports, and of loop nights, by what happened to them


def nightly(config: Path, check: bool) -> int:
    """Scan the new exports, add them to the history and write the reports, as a configuration file says."""
    settings = read_config(config, ReadOptions)
    limits = read_profile(settings.limits, settings.loops)
    rules = parse_rules((rule for rule in settings.fail_on if rule != PULL), f"{config}, fail_on")
    done: Done = defaultdict(list)
    found = _exports(settings, done)
    if check:
        lines = [f"{e.name}: {', '.join(terminal(path.name) for path in e.files)}\n" for e in found]
        emit("".join([*lines, *(f"{day}: {word}\n" for word in SAID for day in done[word])]))
        return 3 if done[NOTHING] else 0
    outputs = settings.outputs
    with open_log(settings.log.file, settings.log.format) as log:
        with lock(settings.lock) as stale:
            if stale:
                log(stale, "warning")
            with History(settings.history, create=True, say=lambda text: log(text, "warning")) as store:
                newest = _scan_all(settings, found, store, log, done)
                if not done["scanned"] + done["known"]:
                    raise refusal(InputError, "no_export_read", config, count=len(found))
                places = plant_history(store, limits, horizon=settings.horizon)
                for path in filter(None, (outputs.report, outputs.trend)):
                    make_folder(path.parent)
                if outputs.report is not None:
                    write_report(outputs.report, places, store.half_periods, str(settings.history))
                    log("report", path=str(outputs.report))
                if outputs.trend is not None:
                    write_text(outputs.trend, trend(places).json())
        done[GONE] = gone(places, settings.look_back)
        for word in SAID:
            for day in done[word]:
                log(word, "warning", **{{NOTHING: "inputs", GONE: "loop"}.get(word, "night"): day})
        hits = met(rules, newest.loops) if newest else []
        hits += [p.loop for p in places if p.action == PULL and PULL in settings.fail_on]
        done["alarm"] = sorted(set(hits))
        summary = _summary(settings, done, places)
        log("done", summary=summary)
    emit(summary + "\n")
    return 1 if hits else 3 if done["failed"] or done[INCOMPLETE] or done[NOTHING] else 0


@contextlib.contextmanager
def open_log(path: Path | None, form: str) -> Iterator[Log]:
    """Give a function `log(event, level="info", **values)`; each call is one line.

    Without `path`, lines of text go to standard error (warnings and errors only) and JSON lines to it all."""
    stream = sys.stderr if form == "json" else None
    if path is not None:
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            if path.exists() and path.stat().st_size > LARGEST:
                path.replace(path.with_name(path.name + ".1"))
            stream = path.open("a", 1, encoding="utf-8", errors="backslashreplace")
        except OSError as error:
            raise refusal(BacklashError, "log_file", path, problem=error.strerror) from None

    def log(event: str, level: str = "info", **values: object) -> None:
        now = datetime.now(UTC).isoformat(timespec="seconds").replace("+00:00", "Z")
        line = terminal(" ".join([event, *(f"{k}={v}" for k, v in values.items() if v not in ("", ()))]))
        if form == "json":
            line = json.dumps({"time": now, "level": level, "event": event, **values}, ensure_ascii=False, default=str)
        if stream is not None:
            stream.write(f"{line}\n" if form == "json" else f"{now} {level} {line}\n")
        elif level != "info":
            say(line)

    with stream if path and stream else contextlib.nullcontext():
        yield log


def _exports(config: NightlyConfig, done: Done) -> list[DatedExport]:
    """Return the exports; note in `done` the days for which there is none, and those too old to be looked at."""
    found, done[OLDER], done[NOTHING] = find_exports(config.inputs, together=config.together,
                                                     look_back=config.look_back)
    if not found:
        raise refusal(InputError, "no_export", f"{config.path}, inputs", patterns=", ".join(done[NOTHING]))
    files = [path for export in found for path in export.files]
    check_places(config, found, [*files, *(Path(str(one)) for one in find_sidecars(files, find_sources(files)))])
    done["missing"] = missing_days(e.name for e in found if e.date)
    return found


def _scan_all(config: NightlyConfig, found: Sequence[DatedExport], store: History, log: Log, done: Done
              ) -> ScanResult | None:
    """Scan what is new into the history, note in `done` what happened, and return the last scan."""
    scan: ScanResult | None = None
    before, known = f"{config.path.stem}:", store.exports()
    done[OLDER] = [name for name in done[OLDER] if before + name not in known]
    newest = max((e.date for e in found if e.date and before + e.name in known), default=None)
    for export in found:
        name, key = export.name, before + export.name
        with contextlib.ExitStack() as stack:
            try:
                settings = [config.loops] if config.loops else find_sidecars(export.files, find_sources(export.files))
                fingerprint = export.fingerprint([Path(path) for path in settings], salt=__version__)
                if known.get(key, "").removeprefix(INCOMPLETE) == fingerprint:
                    done["known"].append(name)
                    done[INCOMPLETE] += [name] * (known[key] != fingerprint)
                    log("known", night=name)
                    continue
                job = Job(Export(export.files, config.loops, config.reading), ScanOptions(carry=True), config.jobs,
                          shown=False)
                # what a job that was killed had finished of this night is taken over
                again = (key, job.export.reading, job.options)
                job.keep = stack.enter_context(kept(config.history, again, resume=True))
                scan = job.scan()
            except (OSError, BacklashError) as error:
                done["failed"].append(name)
                log("failed", "error", night=name, reason=getattr(error, "strerror", None) or str(error))
                continue
            if config.outputs.scan is not None:  # before the history calls the night known
                _write_scan(config.outputs.scan, config.outputs.keep, name, scan, job.plant, log)
            outcome = store.add(scan, export=(key, INCOMPLETE * bool(missed := lost(scan)) + fingerprint))
        if job.taken_over:
            log("resumed", night=name, loops=job.taken_over)
        late = newest is not None and export.date is not None and export.date < newest
        more = [what for what in ("new", "revised", "unchanged") if outcome[what]]
        told = {"scanned": True, "late": late, INCOMPLETE: bool(missed), "misdated": export.misdated(scan.loops),
                REVISED: key not in known and "revised" in more, REPEATED: key not in known and more == ["unchanged"]}
        for word, names in (*outcome.items(), *((word, [name]) for word, holds in told.items() if holds)):
            done[word] += names
        log("scanned", night=name, loops=len(scan.loops), history=sentence("stored", outcome), late=late)
        for reason in missed:
            log("not analysed", "warning", night=name, reason=reason)
        for note in scan.warnings:
            log(note.code, "warning" if note.code in DAMAGE else "info", night=name, reason=note.message)
    return scan


def _write_scan(pattern: str, keep: int, name: str, result: ScanResult, plant: Mapping[str, Record], log: Log) -> None:
    """Write the report of one night and remove the oldest ones beyond `keep`."""
    target = Path(expand(pattern, name))
    make_folder(target.parent)
    write(result, plant, check_delivery(None, target, "loops") or "table", target)
    for _, path in sorted((night, path) for path, night in matches(pattern) if night is not None)[:-keep]:
        path.unlink(missing_ok=True)
        log("removed", report=path.name)


def _summary(config: NightlyConfig, done: Done, places: Sequence[Place]) -> str:
    last = max((n.end for p in places for n in p.wear.nights), default=None)
    nights = ", ".join(f"{len(done[word])} {said}" for word, said in (
        ("new", "new"), ("revised", "revised"), ("unchanged", "known")) if done[word]) or "none"
    said = {TO_DO[action]: [p.loop for p in places if p.action == action] for action in (PULL, "room", "watch")}
    said |= {word: done[word] for word in ("late", *SAID, "failed", "alarm")}
    parts = [f"backlash {day(last) if last is not None else 'no data'}: {counted(len(places), 'loop')}",
             f"scanned {some(done['scanned'], 5)} (loop nights: {nights})" if done["scanned"] else
             f"nothing new ({len(done['known'])} known)"]
    parts += [f"{words} {some(found, 5)}" for words, found in said.items() if found]
    return terminal("; ".join(parts + [f"report {config.outputs.report}"] * (config.outputs.report is not None)))
