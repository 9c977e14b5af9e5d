"""What a stopped scan leaves behind: reports come back exactly, cut lines are left out, old files go."""

import math
import os
import pickle
import time
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from backlash_cli.errors import BacklashError
from backlash_cli.history.unfinished import Unfinished, from_text, to_text
from backlash_cli.record import LoopSettings, Note
from backlash_cli.reporter.json_report import to_json
from backlash_cli.results import LoopReport, ScanResult, Verdict
from backlash_cli.scanning import ScanOptions, scan
from tests.small_plant import records


@pytest.fixture(scope="module")
def reports():
    return [scan(record, ScanOptions(carry=True)) for record in records()]


def same(one, other):
    return one == other and one.carry == other.carry and to_json(ScanResult((one,))) == to_json(ScanResult((other,)))


def test_reports_come_back_as_they_were(reports):
    for report in reports:
        back = from_text(to_text("k", report))[1]
        assert same(back, report) and back.carry and isinstance(back.verdict, Verdict)
        assert any(report.estimates) and back.estimates == report.estimates


text = st.text(max_size=9)
number = st.floats(allow_nan=False) | st.integers(-(2**63), 2**63 - 1)
plain = st.recursive(st.none() | st.booleans() | number | text | st.binary(max_size=9),
                     lambda inner: st.tuples(inner, inner) | st.lists(inner, max_size=3)
                     | st.dictionaries(text | st.just("~"), inner, max_size=3), max_leaves=8)
notes = st.builds(Note, text, text, st.dictionaries(text, number | text, max_size=3))


@settings(deadline=None, suppress_health_check=[HealthCheck.too_slow], max_examples=50)
@given(st.builds(LoopReport, text, st.sampled_from(Verdict), st.tuples(notes), details=st.dictionaries(text, plain),
                 settings=st.builds(LoopSettings, st.floats(allow_nan=False),
                                    source=st.dictionaries(text, text, max_size=2))))
def test_any_report_comes_back_as_it_was(report):
    kept = to_text("k", report)
    key, back = from_text(kept)
    assert key == "k"
    assert to_json(ScanResult((back,))) == to_json(ScanResult((report,))) and b"\n" not in kept
    assert back.settings == report.settings and back.reasons == report.reasons


def test_numbers_of_arrays_and_of_no_size_come_back():
    values = {"a": np.float64(0.1), "b": np.int64(3), "c": math.nan, "d": -math.inf, "e": np.True_}
    kept = from_text(to_text("k", LoopReport("a", Verdict.BACKLASH, details=values)))[1].details
    assert kept["a"] == 0.1 and kept["b"] == 3 and kept["d"] == -math.inf and kept["e"] is True
    assert math.isnan(kept["c"])
    with pytest.raises(TypeError):
        to_text("k", LoopReport("a", Verdict.BACKLASH, details={"a": object()}))
    for other in (b"", b"%%", b"AAAA", to_text("k", LoopReport("a", Verdict.ERROR))[:-8]):
        with pytest.raises(ValueError):
            from_text(other)


def test_what_was_finished_is_known_when_resumed_and_only_then(tmp_path, reports):
    history, scanned = tmp_path / "h.db", ("plant.csv", ScanOptions())
    begun = Unfinished(history, scanned, resume=False)
    begun.add("k0", reports[0])
    pickle.loads(pickle.dumps(begun)).add("k1", reports[1])
    begun.add("k2", replace(reports[2], verdict=Verdict.ERROR))  # tried again
    begun.add("", reports[2])
    begun.close()
    again = Unfinished(history, scanned, resume=True)
    assert set(again.known) == {"k0", "k1"}
    assert same(again.known["k0"], reports[0]) and same(again.known["k1"], reports[1])
    assert not Unfinished(history, ("plant.csv", ScanOptions(confirm=False)), resume=True).known
    assert not Unfinished(history, scanned, resume=False).known
    assert not Unfinished(history, scanned, resume=True).known
    again.close(ended=True)
    assert not again.path.exists()


def test_a_line_cut_anywhere_costs_that_loop_only(tmp_path, reports):
    store = Unfinished(tmp_path / "h.db", (), resume=False)
    short = [replace(report, estimates=(), carry=None) for report in reports]
    store.add("k0", short[0])
    first = store.path.stat().st_size
    store.add("k1", short[1])
    store.close()
    whole = store.path.read_bytes()
    for cut in {first, first + 1, first + 9, (first + len(whole)) // 2, len(whole) - 2}:
        store.path.write_bytes(whole[:cut])
        again = Unfinished(tmp_path / "h.db", (), resume=True)
        assert set(again.known) == {"k0"}
        again.add("k2", short[2])
        again.close()
        assert set(Unfinished(tmp_path / "h.db", (), resume=True).known) == {"k0", "k2"}


def test_what_was_never_resumed_goes_after_a_month(tmp_path):
    old, new = (Unfinished(tmp_path / "h.db", name, resume=False) for name in "ab")
    other = tmp_path / "h.db.unfinished-mine"
    other.write_text("")
    for path in (old.path, other):
        os.utime(path, (time.time() - 31 * 86400,) * 2)
    Unfinished(tmp_path / "h.db", "c", resume=False)
    assert not old.path.exists() and new.path.exists() and other.exists()


def test_a_place_that_cannot_be_written_is_said_at_the_start(tmp_path):
    with pytest.raises(BacklashError, match="folder of the history"):
        Unfinished(tmp_path / "none" / "h.db", (), resume=False)
    os.mkfifo(pipe := tmp_path / "pipe")
    for folder in (tmp_path, ".", pipe):
        with pytest.raises(BacklashError, match="this is a folder"):
            Unfinished(folder, (), resume=False)
    assert [*tmp_path.iterdir()] == [pipe]


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no device that is always full")
def test_a_full_disk_costs_only_the_resuming(tmp_path, reports):
    store = Unfinished(tmp_path / "h.db", (), resume=False)
    store.path.unlink()
    store.path.symlink_to("/dev/full")
    store.add("k0", reports[0])
