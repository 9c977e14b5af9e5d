"""explain --all and compensate on a cluster: what they say here, also when workers die. The cluster of test_dask."""

import json
import os
import re
import signal
from dataclasses import replace
from importlib.util import find_spec

import pytest

from backlash_cli.check import check_loop
from backlash_cli.engines.local import answers
from tests.commands.run import files, run
from tests.small_plant import records, write_plant

pytestmark = pytest.mark.skipif(find_spec("distributed") is None,  # which takes seconds to load, in each worker
                                reason="dask is not installed: pip install 'backlash[dask]'")


@pytest.fixture(scope="module")
def export(tmp_path_factory):
    """Three loops, a fourth without numbers, and a file that is none."""
    folder = tmp_path_factory.mktemp("workbench") / "set"
    folder.mkdir()
    write_plant(folder, hours=0.3)
    rows = "\n".join(f"2026-03-17T08:{12 + s // 60}:{s % 60:02},50,Bad,40" for s in range(300))
    (folder / "e.csv").write_text(f"time,E.SP,E.PV,E.OP\nx,y\n{rows}\n")
    (folder / "f.csv").write_text("")
    return folder


def there(client):
    return "--engine", "dask", "--scheduler", client.cluster.scheduler_address


def test_explain_all_says_the_same_on_a_cluster(capfd, client, export, tmp_path):
    told = ("explain", export, "--all", "--since", "5min", "--loops-matching", "PIC*", "--loops-matching", "E")
    here = run(capfd, *told, "--jobs", 1, "--output", tmp_path / "here")
    cluster = run(capfd, *told, *there(client), "--output", tmp_path / "there")
    assert here.status == cluster.status == 3 and cluster.err.replace("there", "here") == here.err
    assert "not explained: E:" in here.err and "f.csv" in here.err
    assert len(json.loads((tmp_path / "here" / "summary.json").read_text())["loops"]) == 1
    found, wanted = ({name: re.sub(rb"<code>backlash explain .*?</code>", b"", text)  # the command line differs
                      for name, text in files(tmp_path / place).items()} for place in ("there", "here"))
    assert found == wanted


class Deadly:
    """Ends the process that unpickles it."""

    def __reduce__(self):
        return os._exit, (1,)


def test_a_loop_whose_workers_die_is_named_and_the_others_are_answered(client):
    first, second = records()[:2]
    deadly = replace(first, disturbances={"x": Deadly()})
    found = list(answers([deadly, second], check_loop, client=client))  # as explain is sent, and much quicker
    assert "killed every time" in found[0].message and found[0].values["loop"] == first.loop
    assert found[1].loop == second.loop and found[1].quality


def test_a_compensator_is_studied_on_a_worker_also_when_one_is_killed(capfd, client, export):
    told = ("compensate", export, "--loop", "pic303", "--json", "-")
    here = run(capfd, *told)
    client.wait_for_workers(2)
    os.kill(client.run(os.getpid).popitem()[1], signal.SIGKILL)
    cluster = run(capfd, *told, *there(client))
    assert here.status == cluster.status == 0 and cluster.out == here.out
    for wrong in (("--loop", "PIC9"), ("--loop", "E"), ("--loop", "TIC202")):
        here, cluster = (run(capfd, "compensate", export, *wrong, *more) for more in ((), there(client)))
        assert here.status == cluster.status == 2 and cluster.err == here.err


def test_engine_goes_with_all(capfd, export):
    done = run(capfd, "explain", export, "--loop", "PIC303", "--engine", "dask")
    assert done.status == 2 and "--engine goes with --all" in done.err
