"""One quality for a whole row of signals: a bad row is bad for all of them."""

import numpy as np
import pytest

from backlash_cli import read
from backlash_cli.record import SampleState

HEADS = ("Time,SP,PV,OP,Quality", "Time,Quality,SP,PV,OP", "Time,Loop,SP,PV,OP,Status",
         "Time,FIC101.SP,FIC101.PV,FIC101.OP,FIC102.SP,FIC102.PV,FIC102.OP,OPCQuality")


@pytest.mark.parametrize("head", HEADS)
def test_a_quality_of_the_row_marks_every_signal(tmp_path, head):
    names, lines = head.split(","), [head]
    for k in range(300):
        cells = {"Time": f"2026-03-17 08:{k // 60:02d}:{k % 60:02d}", "Loop": "FIC101", "SP": "50",
                 "PV": f"{50 + np.sin(k / 7):.3f}", "OP": f"{40 + np.cos(k / 7):.3f}"}
        mark = "Bad" if 100 <= k < 120 else "Good"
        lines.append(",".join(cells.get(name.split(".")[-1], mark) for name in names))
    path = tmp_path / "FIC101.csv"
    path.write_text("\n".join(lines) + "\n")
    for record in read(path):
        assert not record.usable[record.index == 110].any(), record.loop
        assert np.count_nonzero(record.state == SampleState.GOOD) == 280


def test_a_quality_behind_pv_marks_pv_alone(tmp_path):
    lines = ["Time,SP,PV,Quality,OP"]
    lines += [f"2026-03-17 08:{k // 60:02d}:{k % 60:02d},50,{50 + np.sin(k / 7):.3f},"
              f"{'Bad' if k == 110 else 'Good'},{40 + np.cos(k / 7):.3f}" for k in range(300)]
    path = tmp_path / "FIC101.csv"
    path.write_text("\n".join(lines) + "\n")
    (record,) = read(path)
    assert np.isfinite(record.output[record.index == 110]).all()
    assert record.state[record.index == 110] != SampleState.GOOD
