"""The history file: the same content whatever the order, however often, and wherever a run was killed."""

import itertools
import json
import random
import sqlite3
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from backlash_cli.errors import BacklashError
from backlash_cli.history.joins import active
from backlash_cli.history.store import APPLICATION, STEPS, History
from backlash_cli.reporter.templates import sentence
from backlash_cli.results import Verdict
from backlash_cli.results.history import day_of
from tests.history.nights import DAY, MARCH, cut, growing, made, result
from tests.killed_writers import TELL, killed
from tests.test_scan import RECORD


def dump(path):
    with sqlite3.connect(path) as db:
        assert db.execute("PRAGMA integrity_check").fetchone()[0] == "ok"
        return list(db.iterdump())


def filled(path, reports):
    with History(path, create=True) as history:
        for report in reports:
            history.add(result(report))
    return dump(path)


def test_scanning_again_changes_nothing(tmp_path):
    reports = growing(20)
    clean = filled(tmp_path / "a.db", reports)
    with History(tmp_path / "a.db") as history:
        outcome = history.add(result(reports[17]))
    assert outcome["unchanged"] == [("FIC101", "2026-03-18")] and not outcome["new"]
    assert sentence("stored", outcome) == "1 night known and unchanged"
    assert dump(tmp_path / "a.db") == clean


@given(st.integers(0, 10**6))
@settings(max_examples=8, deadline=None)
def test_any_order_and_repetition_of_nights_gives_the_same_file(tmp_path_factory, seed):
    folder = tmp_path_factory.mktemp("order")
    reports = cut(RECORD, [900, 1800, 1850, 3000, 4200])
    messy = [*reports, reports[2], reports[2], reports[4]]
    random.Random(seed).shuffle(messy)
    assert filled(folder / "a.db", reports) == filled(folder / "b.db", messy)


@pytest.mark.parametrize("edges", [[3000], [500, 510, 520, 3000], [700, 1400, 2100, 2800, 3500, 4200]])
def test_nights_cut_anywhere_hold_the_half_periods_of_the_whole(tmp_path, edges):
    whole, pieces = cut(RECORD, []), cut(RECORD, edges)
    random.Random(1).shuffle(pieces)
    filled(tmp_path / "whole.db", whole)
    filled(tmp_path / "pieces.db", pieces)
    with History(tmp_path / "whole.db") as a, History(tmp_path / "pieces.db") as b:
        want = [(p.start, p.end, p.d) for p in a.half_periods("FIC101") if p.accepted]
        got = [(p.start, p.end, p.d) for p in b.half_periods("FIC101") if p.accepted]
        assert any(p.joined for p in b.half_periods("FIC101"))
    np.testing.assert_allclose(np.array(got) - [MARCH, MARCH, 0], np.array(want) - [MARCH, MARCH, 0], atol=2e-3)
    np.testing.assert_allclose([g[2] for g in got], [w[2] for w in want], rtol=1e-6)


def test_overlapping_exports_count_no_half_period_twice(tmp_path):
    from backlash_cli.scanning import ScanOptions, scan

    reports = []
    for first, last in ((0, 3001), (3000, 6000), (2000, 5000)):
        block = RECORD.slice(first, last)
        reports.append(scan(replace(block, loop="FIC101", start=MARCH + first, index=block.index - first),
                            ScanOptions(confirm=False, carry=True)))
    filled(tmp_path / "a.db", reports)
    whole = [e for e in scan(RECORD).estimates if e.accepted]
    with History(tmp_path / "a.db") as history:
        found = [p for p in history.half_periods("FIC101") if p.accepted]
    assert all(a.end <= b.start + 0.3 * b.dt_s for a, b in itertools.pairwise(found))
    assert abs(len(found) - len(whole)) <= 1
    assert sum(p.dt_s for p in found) == pytest.approx(sum(e.dt_s for e in whole), rel=0.1)


def test_an_export_taken_too_early_gives_way_to_the_full_one():
    assert active([(0, 10), (0, 100), (100, 200)]) == [(0, 100), (100, 200)]
    assert active([(0, 100), (0, 50), (50, 100)]) == [(0, 50), (50, 100)]
    assert active([(0, 100), (50, 150)]) == [(0, 100), (50, 150)]
    assert active([(0, 100), (50, 150), (60, 90)]) == [(0, 100), (50, 150)]
    assert active([(k, k + 1) for k in range(60)] + [(0, 60)]) == [(k, k + 1) for k in range(60)]


@given(st.lists(st.tuples(st.integers(0, 20), st.integers(1, 20)).map(lambda s: (s[0], s[0] + s[1])), max_size=12))
def test_exports_that_count_do_not_lie_inside_each_other_and_cover_nearly_all(spans):
    kept = active(spans)
    assert kept == sorted(set(kept)) and set(kept) <= set(spans) and active(spans[::-1]) == kept
    assert not any(a != b and a[0] <= b[0] and b[1] <= a[1] for a in kept for b in kept)


def test_a_corrected_export_replaces_the_night(tmp_path):
    reports = growing(5)
    filled(tmp_path / "a.db", reports)
    with History(tmp_path / "a.db") as history:
        outcome = history.add(result(made(2, 0.033)))
        assert outcome["revised"] == [("FIC101", "2026-03-03")]
        assert history.nights("FIC101")[2].d == pytest.approx(0.033)
        assert len(history.nights("FIC101")) == 5


def test_a_night_keeps_what_the_report_said(tmp_path):
    filled(tmp_path / "a.db", [made(0, 0.02), made(1, None, verdict=Verdict.NO_BACKLASH), made(2, None, lod=None,
           verdict=Verdict.CANNOT_TELL)])
    with History(tmp_path / "a.db") as history:
        a, b, c = history.nights("FIC101")
        assert history.loops() == ["FIC101"]
        assert [len(r["inputs"]) for r in history.runs()] == [1, 1, 1]
    assert (a.d, a.source, a.ci95) == (0.02, "confirmation", (0.018, 0.022))
    assert day_of(a.time) == "2026-03-01" and a.settings["Ti"] == 28.0 and a.reasons[0].code == "made"
    assert b.below_detection and b.limit_of_detection == 0.005 and not c.below_detection and c.d is None


def test_odd_names_and_times_do_no_harm(tmp_path):
    with History(tmp_path / "a.db", create=True) as history:
        for name in ("\udc80x", "a\x00b", "", "é", "x" * 5000):
            history.add(result(made(0, 0.02, loop=name)))
            assert not history.add(result(made(0, 0.02, loop=name)))["new"]
        assert len(history.loops()) == 5 and "\\udc80x" in history.loops()
        for start in (-1e12, 1e14, float("nan"), None):
            outcome = history.add(result(replace(made(0, 0.02), start=start, end=start)))
            assert outcome["untimed"] == ["FIC101"] and "not stored" in sentence("stored", outcome)


def test_repairs_are_marked_once(tmp_path):
    with History(tmp_path / "a.db", create=True) as history:
        assert history.mark_repair("FIC101", MARCH + DAY, "new packing")
        assert not history.mark_repair("FIC101", MARCH + DAY, "new packing")
        assert [r.note for r in history.repairs("FIC101")] == ["new packing"]
        assert history.remove_repair("FIC101", MARCH + DAY) and not history.remove_repair("FIC101", MARCH + DAY)


def test_a_version_1_file_is_brought_up_to_date(tmp_path):
    path = tmp_path / "old.db"
    with sqlite3.connect(path) as db:
        for statement in STEPS[0]:
            db.execute(statement)
        db.execute("PRAGMA user_version = 1")
        db.execute(f"PRAGMA application_id = {APPLICATION}")
        db.execute("INSERT INTO nights VALUES ('FIC101', ?, ?, 'x', 'backlash', 0.8, 0.02, 0.018, 0.022, 'cluster', "
                   "0.004, 86400, 1.0, 40, 10, '{\"K\": 0.6, \"Ti\": 28}', '[]', '[]')", (MARCH, MARCH + DAY - 1))
        db.execute("INSERT INTO repairs VALUES ('FIC101', ?, 'new packing')", (MARCH,))
    with History(path) as history:
        assert history.nights("FIC101")[0].d == 0.02 and history.repairs("FIC101")[0].note == "new packing"
        history.add(result(made(1, 0.021)))
        assert len(history.nights("FIC101")) == 2
    fresh = tmp_path / "fresh.db"
    History(fresh, create=True).db.close()
    with sqlite3.connect(path) as old, sqlite3.connect(fresh) as new:
        for table in ("nights", "half_periods", "runs", "repairs"):
            columns = f"PRAGMA table_info({table})"
            assert old.execute(columns).fetchall() == new.execute(columns).fetchall()
        assert old.execute("PRAGMA user_version").fetchone()[0] == len(STEPS)


def test_a_version_2_file_forgets_the_joins_that_it_kept(tmp_path):
    reports = cut(RECORD, [500, 3000])
    filled(tmp_path / "fresh.db", reports)
    filled(tmp_path / "old.db", reports)
    with sqlite3.connect(tmp_path / "old.db") as db:
        db.execute("CREATE TABLE joins (loop TEXT, start REAL, end REAL, of TEXT, until REAL, tail BLOB)")
        db.execute("INSERT INTO half_periods SELECT loop, night_start, night_end, 1, start - 30, end, dt_s, dy, e_max, "
                   "d, direction, accepted, why FROM half_periods")
        db.execute("PRAGMA user_version = 2")
    with History(tmp_path / "fresh.db") as fresh, History(tmp_path / "old.db") as old:
        assert old.half_periods("FIC101") == fresh.half_periods("FIC101") != []
    assert sorted(dump(tmp_path / "old.db")) == sorted(dump(tmp_path / "fresh.db"))


def refused(path, **options):
    with pytest.raises(BacklashError) as caught:
        History(path, **options)
    assert caught.value.remedy
    return caught.value.code


def test_what_is_no_history_is_refused_with_a_remedy(tmp_path):
    assert refused(tmp_path / "absent.db") == "no_history"
    assert refused(tmp_path / "no" / "folder.db", create=True) == "no_history"
    (tmp_path / "text.db").write_text("time,value\n" * 500)
    assert refused(tmp_path / "text.db", create=True) == "history_unusable"
    with sqlite3.connect(tmp_path / "other.db") as db:
        db.execute("CREATE TABLE things (a)")
    assert refused(tmp_path / "other.db", create=True) == "not_a_history"


@pytest.mark.parametrize("wrong", ["UPDATE nights SET d = 'x'", "UPDATE nights SET verdict = 'fine'",
    "UPDATE nights SET details = 'no JSON'", "INSERT INTO repairs VALUES ('FIC101', 'yesterday', 'x')"])
def test_a_row_that_no_scan_wrote_is_damage(tmp_path, wrong):
    with History(tmp_path / "h.db", create=True) as store:
        store.add(result(growing(2)[0]))
        store.db.execute(wrong)
    with pytest.raises(BacklashError, match=r"h\.db: the history file is damaged .* restore it"), History(
            tmp_path / "h.db") as store:
        store.nights("FIC101")
        store.repairs("FIC101")
    with History(tmp_path / "new.db", create=True) as history:
        history.db.execute("PRAGMA user_version = 99")
    assert refused(tmp_path / "new.db") == "newer_history"


def test_a_second_run_waits_says_so_and_gives_up_in_words(tmp_path):
    path = tmp_path / "a.db"
    filled(path, [made(0, 0.02)])
    other = sqlite3.connect(path, isolation_level=None)
    other.execute("BEGIN IMMEDIATE")
    said = []
    with History(path, patience=0.3, say=said.append) as history:
        with pytest.raises(BacklashError) as caught:
            history.add(result(made(1, 0.02)))
        assert caught.value.code == "history_busy" and "another run" in said[0]
        other.execute("ROLLBACK")
        history.add(result(made(1, 0.02)))
        assert len(history.nights("FIC101")) == 2
    other.close()


BEGIN = """
from backlash_cli.history.store import History
from tests.history.nights import growing, result
reports = growing(40)
"""
WORK = TELL + """
with History(sys.argv[1], create=True) as history:
    for report in reports:
        history.add(result(report))
"""


def test_a_run_killed_at_any_moment_leaves_the_file_sound(tmp_path):
    clean = filled(tmp_path / "clean.db", growing(40))
    path = tmp_path / "killed.db"
    rng = np.random.default_rng(17)
    for _ in killed(BEGIN, WORK, path, rng.uniform(0, 0.25, 5)):
        if path.exists():
            with sqlite3.connect(path) as db:
                assert db.execute("PRAGMA integrity_check").fetchone()[0] == "ok"
    assert filled(path, growing(40)) == clean


@pytest.mark.parametrize(("name", "code", "says"), [
    ("SQLITE_BUSY_SNAPSHOT", "history_busy", "another run"),
    ("SQLITE_IOERR_WRITE", "history_unusable", "the disk reports"),
    ("", "history_unusable", "cannot be used: a -> b")])
def test_every_error_of_the_database_is_told_in_words(tmp_path, name, code, says):
    """Extended codes too, and those that Python's own module raises, which have none."""
    with History(tmp_path / "h.db", create=True) as history:
        error = sqlite3.OperationalError("a -> b")
        if name:
            error.sqlite_errorname = name
        with pytest.raises(BacklashError, match=says) as found, history._in_words():
            raise error
        assert found.value.code == code and found.value.remedy


def test_an_error_of_what_is_done_with_a_history_is_no_damage_of_it(tmp_path):
    with pytest.raises(json.JSONDecodeError), History(tmp_path / "h.db", create=True):
        json.loads("no JSON")
