"""Parts of a plant, put together, say what one reading of the whole says: in every layout, to the byte."""

import numpy as np
import pyarrow.csv
import pytest

from backlash_cli.api import scan_files
from backlash_cli.errors import BacklashError
from backlash_cli.loaders import ReadOptions
from backlash_cli.loaders.parts import cut_parts
from backlash_cli.reporter.json_report import to_json
from tests.engines.parts import QUICK, in_parts, plan_of
from tests.loaders.test_layouts import EXPORTS, by_loop
from tests.loaders.test_more_layouts import MORE
from tests.loaders.test_partitions import LAYOUTS, write
from tests.small_plant import TRUTH, write_plant

EVERY = {**dict(list(EXPORTS.items())[::3]), **dict(list(MORE.items())[::2])}


def whole(inputs, reading=None, loops=None):
    return scan_files(inputs, loops=loops, reading=reading, options=QUICK, jobs=1)


@pytest.fixture(scope="module")
def plant(tmp_path_factory):
    path = write_plant(tmp_path_factory.mktemp("plant"), hours=0.2)
    return path, pyarrow.csv.read_csv(path)


@pytest.mark.parametrize("key", EVERY)
def test_every_export_in_parts_gives_the_report_of_the_whole(key, tmp_path):
    export = EVERY[key]
    inputs, reading = export.write(tmp_path), ReadOptions(**export.options)
    assert to_json(in_parts(inputs, reading)) == to_json(whole(inputs, reading))


@pytest.mark.parametrize("layout", LAYOUTS)
def test_every_folder_in_parts_gives_the_report_of_the_whole(plant, tmp_path, layout):
    path, table = plant
    write(tmp_path / "plant", LAYOUTS[layout](table))
    loops = path.parent / "plant.loops.toml"
    want = to_json(whole([tmp_path / "plant"], None, loops))
    assert to_json(in_parts([tmp_path / "plant"], None, loops)) == want
    assert to_json(in_parts([tmp_path / "plant"], None, loops, single=False)) == want


@pytest.mark.parametrize("reading", [
    {"since": "5min"}, {"since": "2026-03-17T08:05:00"}, {"sample": "2"}, {"loops_matching": ("*C1*", "/^PIC/")},
    {"only_loops": ("FIC*",)}, {"since": "5min", "sample": "50%", "sample_seed": 3},
], ids=str)
def test_what_is_not_computed_is_the_same_in_parts(plant, reading):
    options = ReadOptions(**reading)
    found = whole([plant[0]], options)
    assert to_json(in_parts([plant[0]], options)) == to_json(found)
    assert found.warnings or "only_loops" in reading


def names_and_tags(folder):
    """Loops that the settings know by other names, by single tags, twice, or not at all; indicators; foreign tags."""
    head = ["time", "AREA1/fic101.SP", "AREA1/fic101.PV", "AREA1/fic101.OP", "FT211.PV", "FT211.SP", "TI5", "X1.PV",
            "PIC303_A.SP", "PIC303_A.PV", "PIC303_B.SP", "PIC303_B.PV", "SC9.SP", "LV.OP", "tic202.SP", "tic202.PV"]
    rows = [f"2026-03-01T00:{s // 60:02}:{s % 60:02}," + ",".join(f"{50 + (s * (k + 3)) % 11}" for k in range(15))
            for s in range(300)]
    (folder / "plant.csv").write_text("\n".join([",".join(head), *rows]) + "\n")
    (folder / "loops.toml").write_text("""
        [defaults]
        K = 0.5
        Ti = 20
        pv_range = [0, 100]
        [loops.FIC101]
        K = 0.6
        [loops.PIC303]
        [loops.TIC202]
        sp = "SC9.SP"
        [loops.LIC1]
        pv = "FT211.PV"
        op = "LV.OP"
        [loops.GONE]
        pv = "NOT.THERE"
        [loops.GONE2]
        [loops.FT211]
        Kp = 2.0
    """)
    return [folder / "plant.csv"]


def faults(folder):
    """Ragged rows, a damaged file, an empty one, an encoding, a loop without numbers, and one without PV."""
    head = "time,{0}.SP,{0}.PV,{0}.OP\n"
    rows = [f"2026-03-01T00:{s // 60:02}:{s % 60:02},50,{50 + s % 7},{40 + s % 5}" for s in range(300)]
    (folder / "a.csv").write_text(head.format("A") + "\n".join([*rows[:9], "x,y", *rows[9:]]) + "\n")
    (folder / "b.csv").write_text("")
    (folder / "c.csv").write_bytes(b"PAR1" + bytes(200))
    (folder / "d.csv").write_bytes((head.format("D") + "\n".join(rows)).encode().replace(b"time,", b"time [\xb5s],", 1))
    words = "\n".join(row.rsplit(",", 2)[0] + ",Bad,1" for row in rows)
    (folder / "e.csv").write_text(head.format("E") + words + "\n")
    (folder / "f.csv").write_text("time,F.SP,F.OP\n" + "\n".join(row.rsplit(",", 1)[0] for row in rows) + "\n")
    (folder / "loops.toml").write_text("[defaults]\nK = 0.5\nTi = 20\npv_range = [0, 100]\n[loops.F]\n[loops.Z]\n")
    return [folder]


@pytest.mark.parametrize("make", [names_and_tags, faults])
def test_odd_names_and_faults_are_the_same_in_parts(make, tmp_path):
    inputs = make(tmp_path)
    assert to_json(in_parts(inputs)) == to_json(whole(inputs))


@pytest.mark.parametrize(("files", "words"), [
    ({"a.csv": ""}, "empty"), ({"a.csv": "", "b.csv": b"\x00" * 90}, "none of 2 files"),
    ({"a.csv": "time,alpha,beta\n1,2,3\n2,3,4\n"}, "no loop found"),
    ({"a.csv": "time,A.SP,A.OP\n" + "".join(f"{s},1,2\n" for s in range(99))}, "no measurement"),
])
def test_what_cannot_be_read_at_all_is_the_same_error(files, words, tmp_path):
    for name, text in files.items():
        (tmp_path / name).write_bytes(text if isinstance(text, bytes) else text.encode())
    said = []
    for run in (whole, in_parts):
        with pytest.raises(BacklashError, match=words) as caught:
            run([tmp_path])
        said.append(str(caught.value))
    assert said[0] == said[1]


def test_parts_hold_every_loop_once_and_files_stay_together(tmp_path):
    parts = {f"area{k}/loop=FIC{j}/part-0.parquet": by_loop("FIC101").slice(0, 20) for k in range(2) for j in range(90)}
    write(tmp_path / "plant", parts)
    plan = plan_of([tmp_path / "plant"])
    found = cut_parts(plan, 4)
    names = [name for part in found for name in part.loops]
    assert sorted(names) == sorted(plan.loops) and len(names) == 90 and max(len(p.loops) for p in found) <= 50
    for part in found:
        own = {str(plan.sources[k].path) for name in part.loops for k in plan.loops[name]}
        assert own == {str(s.path) for s in part.sources} and len(own) == 2 * len(part.loops)
    few = cut_parts(plan, 4, ["FIC3", "FIC7"])
    assert [part.loops for part in few] == [("FIC3", "FIC7")]


def test_a_csv_is_cut_into_no_more_parts_than_there_are_workers(plant, monkeypatch):
    monkeypatch.setattr("backlash_cli.loaders.parts.SMALLEST", 1)
    plan = plan_of([plant[0]])
    assert len(cut_parts(plan, 2)) == 2 and len(cut_parts(plan, 100)) == len(TRUTH)
    assert [p.loops for p in cut_parts(plan, 1)] == [tuple(sorted(TRUTH))]


def test_a_part_carries_only_the_settings_of_its_loops(tmp_path):
    names_and_tags(tmp_path)
    plan = plan_of([tmp_path / "plant.csv"])
    part = plan.part(["FIC101"])
    assert set(part.metadata.loops) == {"FIC101"} and part.reading.share is not None
    assert part.reading.share.renamed == (("AREA1/fic101", "FIC101"),)
    assert np.all([source.beside is None for source in part.sources])
