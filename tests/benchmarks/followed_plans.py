"""Plans followed on strange plants: python -m tests.benchmarks.followed_plans N [--seed S] [--repeats R] [--kind KIND].

Loops of `strangers`, healthy or with a dead band of the target's size, whose record a scan leaves undecided. The same
loop goes on with what `plan` proposes: the first option that decides, else the most promising one; the export with the
test in it is scanned again. Prints for every loop what was proposed and what the scan then said, and how many were
decided and right.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from multiprocessing import Pool
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from . import strangers

TARGET = 2.0  # % of the output span
LATER = 48.0  # hours that every loop goes on for at most
FAMILIES = ("flow", "temperature", "pressure", "generic", "level")


def recorded(one: strangers.Loop, seconds: float, folder: str) -> Any:
    """The record of a loop's first seconds, through a file as a user would give it."""
    from backlash_cli import read

    kept = one.time_s < seconds
    stamps = pd.Timestamp("2026-05-04") + pd.to_timedelta(one.time_s[kept], unit="s")
    table: dict[str, object] = {"Timestamp": stamps.strftime("%Y-%m-%d %H:%M:%S.%f").str[:-3]}
    table |= {f"{one.name}.{key}": np.round(getattr(one, key.lower())[kept], 6) for key in ("SP", "PV", "OP")}
    table |= {f"{one.name}.MODE": one.mode[kept]} if one.mode is not None else {}
    file = Path(folder) / "loop.csv"
    pd.DataFrame(table).to_csv(file, index=False)
    given = one.settings or {"K": one.K_ideal, "Ti": one.Ti_ideal, "pv_range": list(one.pv_range)}
    lines = "".join(f"{k} = {json.dumps(v)}\n" for k, v in given.items())
    file.with_suffix(".loops.toml").write_text(f"[loops.{one.name}]\n{lines}")
    return read([file], loops=file.with_suffix(".loops.toml"))[one.name]


def followed(seed: int, repeats: int, kind: str) -> dict[str, Any] | None:
    """Plan and follow one loop; None where the first scan decides it."""
    from backlash_cli.plan import KINDS, PlanOptions, plan
    from backlash_cli.scanning import scan

    truth = "worn" if seed % 2 else "healthy"
    drawn = {"fam": FAMILIES[seed // 2 % len(FAMILIES)], "truth": truth, "size": TARGET if truth == "worn" else 0.0,
             "later_h": LATER, "test": [(0, np.empty(0))]}  # a test of no length: no other stretches in manual
    before = strangers.loop(seed, **drawn)
    hours = before.truth["dur_h"]
    with tempfile.TemporaryDirectory() as folder:
        record = recorded(before, 3600 * hours, folder)
        report = scan(record)
        found = plan(record, PlanOptions(target=TARGET / 100, repeats=repeats, seed=seed,
                                              kinds=(kind,) if kind else KINDS), report)
        if found is None:
            return None
        row = {"loop": before.name, "truth": truth, "before": str(report.verdict), "kind": "-", "hours": np.nan,
               "power": np.nan, "clears": np.nan, "decides": False, "after": "-"}
        tests = [o for o in found.options if o.duration_s is not None and o.duration_s <= 3500 * LATER]
        if not tests:
            return row
        option = max(tests, key=lambda o: (o.decides, min(o.power, o.clears), o.kind == "manual_test"))
        around = 5 * before.Ti_ideal
        row |= {"kind": option.kind, "hours": option.duration_s / 3600, "power": option.power, "clears": option.clears,
                "decides": option.decides}
        begin = 3600 * hours + around * (option.kind != "wait")
        hold = round((option.hold_s or 0.0) / before.truth["dt"])
        held = np.repeat(100 * (option.move or 0.0) * np.array(option.levels), hold)
        moves = {"setpoint_steps": "sp_moves", "manual_test": "test"}.get(option.kind)
        drawn |= {moves: [(round(begin / before.truth["dt"]), held)]} if moves else {}
        after = strangers.loop(seed, **drawn)
        again = scan(recorded(after, begin + option.duration_s + around, folder))
    limit = again.confirmation and again.confirmation.limit_of_detection
    told = again.verdict != "no_backlash" or (limit or 1.0) <= 0.011 * TARGET
    return row | {"after": str(again.verdict) if told else "cleared of more"}


def _one(job: tuple[int, int, str]) -> dict[str, Any] | None:
    try:
        return followed(*job)
    except Exception as error:  # a loop that fails is a loop that is not decided
        return {"loop": str(job[0]), "after": f"failed: {error!r}", "truth": "worn" if job[0] % 2 else "healthy"}


def main() -> None:
    """Plan and follow until N undecided loops were met; print them and the figures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("loops", type=int)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--repeats", type=int, default=100)
    parser.add_argument("--kind", default="", help="wait, setpoint_steps or manual_test. Default: the first proposed")
    parser.add_argument("--jobs", type=int, default=2)
    chosen = parser.parse_args()
    rows: list[dict[str, Any]] = []
    jobs = ((seed, chosen.repeats, chosen.kind) for seed in range(chosen.seed, chosen.seed + 100 * chosen.loops))
    with Pool(chosen.jobs) as pool:
        for row in pool.imap_unordered(_one, jobs):
            if row is not None:
                rows.append(row)
                print(*(f"{v:.2f}" if isinstance(v, float) else v for v in row.values()), flush=True)
            if len(rows) == chosen.loops:
                pool.terminate()
                break
    table = pd.DataFrame(rows)
    right = table.after == table.truth.map({"worn": "backlash", "healthy": "no_backlash"})
    decided = table.after.isin(["backlash", "no_backlash"])
    print(table.to_string(index=False))
    for name, some in (("sure to decide", table.decides == True), ("proposed", table.kind != "-")):  # noqa: E712
        print(f"{name}: {some.sum()} of {len(table)}; decided {(decided & some).sum()}, of these right "
              f"{(right & decided & some).sum()}")
    groups = table.assign(decided=decided, right=right).groupby(["kind", "truth"])
    print(groups[["decided", "right"]].agg(["sum", "count"]))


if __name__ == "__main__":
    main()
