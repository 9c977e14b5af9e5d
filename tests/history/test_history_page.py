"""The picture of the plant at the top of the wear report: sizes against limits, and the last weeks of every loop."""

import pytest

from backlash_cli.history.limits import read_limits
from backlash_cli.history.plant import plant_history
from backlash_cli.history.store import History
from backlash_cli.reporter.history_report import WEEKS, plant_picture, write_report
from backlash_cli.results import Verdict
from tests.history.nights import DAY, MARCH, growing, made, result


@pytest.fixture(scope="module")
def plant(tmp_path_factory):
    with History(tmp_path_factory.mktemp("h") / "h.db", create=True) as history:
        history.add(*[result(r) for r in growing(80, 0.02, 0.05, loop="BAD", seed=1)])
        history.add(*[result(r) for r in growing(80, 0.010, 0.012, loop="GOOD", seed=2)])
        history.add(*[result(made(k, None, loop="BLIND", verdict=Verdict.CANNOT_TELL, lod=None)) for k in range(9)])
        yield plant_history(history, read_limits())


def test_each_loop_has_its_size_its_limit_and_its_last_weeks(plant):
    figure = plant_picture(plant)
    names = [p.loop for p in plant]
    assert figure["layout"]["yaxis"]["ticktext"] == names and names[0] == "BAD" and names[-1] == "BLIND"
    *groups, ticks, limits, lines = figure["data"]
    assert ticks["x"] == [3.0, 3.0, 3.0] and ticks["y"] == [0, 1, 2] and ticks["name"] == "limit"
    at = {names[row]: x for group in groups for row, x in zip(group["y"], group["x"], strict=True)}
    assert at["BAD"] == pytest.approx(100 * plant[0].wear.now.level) and at["BLIND"] == 0.0
    assert [words for group in groups for words in group["text"]].count("no size") == 1
    # a small line for each loop with sizes, no older than the last weeks, within the row of its loop
    assert lines["x"].count(None) == limits["x"].count(None) == 2
    times = [t for t in lines["x"] if t is not None]
    assert min(times) >= 1000 * (MARCH + (80 - 7 * WEEKS - 1) * DAY) and len(times) == 2 * 7 * WEEKS + 2
    first = lines["y"][: lines["y"].index(None)]
    assert -0.5 < min(first) < max(first) < 0.5 and first[-1] < first[0]  # up is more
    level = limits["y"][0]
    above = [y < level for y in first]  # the limit of 3 % was passed on the way
    assert not all(above) and above[-1]


def test_a_report_is_one_file_or_a_folder(plant, tmp_path):
    for name in ("wear.html", "wear"):
        write_report(tmp_path / name, plant, lambda loop, days: ())
    whole, index = (tmp_path / "wear.html").read_text("utf-8"), (tmp_path / "wear" / "index.html").read_text("utf-8")
    for page in (whole, index):
        assert page.index("The plant") < page.index("Order of repair") and "last 8 weeks" in page
        assert f" {len({int(n.time // DAY) for p in plant for n in p.wear.nights})} nights" in page
    assert whole.count("<details") == 3 + 3 and "loops-" in index
