"""backlash as a process: signals, closed pipes, full disks, terminals, and how fast it answers."""

import os
import pty
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.commands.run import COMMAND, files, process
from tests.small_plant import write_plant

# the second loop takes for ever; the line on standard error says that it has begun
SLOW = """
import sys, time
import backlash_cli.engines.local as local
real, calls = local.analyse_loop, []
def slow(record, options, *more):
    calls.append(record)
    if len(calls) == 2:
        print("second loop", file=sys.stderr, flush=True)
        time.sleep(60)
    return real(record, options, *more)
local.analyse_loop = slow
from backlash_cli.__main__ import main
main()
"""


@pytest.fixture(scope="module")
def plant(tmp_path_factory):
    return write_plant(tmp_path_factory.mktemp("plant"), hours=0.3)


@pytest.mark.parametrize(
    ("output", "number", "status"),
    [("r.json", signal.SIGINT, 130), ("pages", signal.SIGTERM, 143)],
)
def test_a_stop_is_quick_says_what_was_done_and_leaves_the_old_report(plant, tmp_path, output, number, status):
    old = tmp_path / output
    if output == "pages":
        old.mkdir()
        old = old / "index.html"
    old.write_text("old")
    before = files(tmp_path)
    form = "html" if output == "pages" else output[2:]
    command = [sys.executable, "-c", SLOW, "scan", str(plant), "--no-confirm", "--format", form]
    running = subprocess.Popen([*command, "--output", str(tmp_path / output)], stdout=subprocess.PIPE,
                               stderr=subprocess.PIPE, text=True)
    assert running.stderr is not None and running.stderr.readline() == "second loop\n"
    began = time.perf_counter()
    running.send_signal(number)
    out, err = running.communicate(timeout=20)
    assert time.perf_counter() - began < 3.0
    assert running.returncode == status and out == ""
    assert "1 of 3 loops were analysed; no report was written" in err and "Traceback" not in err
    assert files(tmp_path) == before


def test_a_stop_ends_the_other_processes_too(plant, tmp_path):
    code = SLOW.replace("if len(calls) == 2:", "if False:")
    script = tmp_path / "slow.py"
    script.write_text(code.replace("main()\n", "if __name__ == '__main__':\n    main()\n"))
    (tmp_path / "t").mkdir()
    for delay in (0.5, 1.3):
        running = subprocess.Popen([sys.executable, str(script), "scan", str(plant), "--jobs", "2"],
                                   stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
                                   env={**os.environ, "TMPDIR": str(tmp_path / "t")})
        time.sleep(delay)
        running.send_signal(signal.SIGTERM)
        _, err = running.communicate(timeout=20)
        assert running.returncode in (0, 143, -signal.SIGTERM), err
        assert "Traceback" not in err
        with pytest.raises(ProcessLookupError):
            until = time.time() + 5
            while time.time() < until:
                os.killpg(running.pid, 0)
                time.sleep(0.05)
        assert not [*(tmp_path / "t").glob("pymp-*")]


@pytest.mark.parametrize(("engine", "delay"), [("local", 1.3), ("dask", 3.0)])
def test_ctrl_c_reaches_every_process_and_is_answered_by_the_first(plant, engine, delay):
    """Also while the process of which the others are forked loads what they need."""
    pytest.importorskip("distributed")
    running = subprocess.Popen([*COMMAND, "scan", str(plant), "--jobs", "2", "--engine", engine], text=True,
                               stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True)
    time.sleep(delay)
    os.killpg(running.pid, signal.SIGINT)
    _, err = running.communicate(timeout=30)  # all of them hold their ends of the pipes
    assert (running.returncode == 130 and "backlash: stopped" in err) or running.returncode == 0
    assert "Traceback" not in err and "KeyboardInterrupt" not in err and "resource_tracker" not in err


def test_processes_load_what_the_first_one_has_loaded(plant, tmp_path):
    """Not what lies in the folder one works in."""
    (tmp_path / "backlash_cli").mkdir()
    for name in ("backlash_cli/__init__.py", "pandas.py"):
        (tmp_path / name).write_text("raise SystemExit('loaded from the folder one works in')")
    code = (f"import sys; sys.path.remove(''); sys.argv[1:] = {['scan', str(plant), '--jobs', '2']}; "
            "from backlash_cli.__main__ import main; main()")
    ended = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert (ended.returncode, ended.stderr) == (0, "")
    assert "3 loops: 2 backlash" in ended.stdout


def test_processes_begin_where_no_socket_can_be_made(plant, tmp_path):
    """In a temporary folder whose name is too long for one."""
    (long := tmp_path / ("t" * 120)).mkdir()
    ended = process("scan", plant, "--no-confirm", "--jobs", 2, env={**os.environ, "TMPDIR": str(long)})
    assert ended.returncode == 0 and "Traceback" not in ended.stderr
    assert "3 loops: 2 suspected, 1 cannot tell" in ended.stdout


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_stop_while_another_process_is_begun_leaves_no_traceback(plant, tmp_path, number):
    """Between its start and the moment when it was told what to do; Ctrl-C reaches it as well."""
    script = tmp_path / "begun.py"
    script.write_text("import os, multiprocessing.popen_forkserver as forking, backlash_cli.__main__\n"
                      "real = forking.Popen._launch\n"
                      "def begun(self, process):\n"
                      "    real(self, process)\n"
                      f"    os.kill(os.getpid(), {int(number)})\n"
                      f"    {int(number)} == {int(signal.SIGINT)} and os.kill(self.pid, {int(number)})\n"
                      "forking.Popen._launch = begun\n"
                      "if __name__ == '__main__':\n    backlash_cli.__main__.main()\n")
    ended = subprocess.run([sys.executable, str(script), "scan", str(plant), "--no-confirm", "--jobs", "2"],
                           capture_output=True, text=True, timeout=30)
    assert ended.returncode == 128 + number and "stopped" in ended.stderr
    assert "Traceback" not in ended.stderr


@pytest.mark.parametrize(("place", "number"), [
    ("threading.Thread.start", signal.SIGTERM), ("backlash_cli.__main__._hear_stops", signal.SIGINT),
    ("backlash_cli.__main__._hear_stops", signal.SIGTERM), ("backlash_cli.__main__.cli.make_context", signal.SIGINT),
    ("os.set_blocking", signal.SIGTERM), ("sys.stdout.flush", signal.SIGINT), ("sys.stdout.flush", signal.SIGTERM)])
def test_a_stop_at_any_moment_leaves_no_traceback(plant, place, number):
    """Before and after the signals are listened for, and when all is said."""
    owner, name = place.rsplit(".", 1)
    code = ("import os, sys, threading, backlash_cli.__main__\n"
            f"real = {place}\n"
            "def stopped(*a, **k):\n"
            f"    answer = real(*a, **k)\n    os.kill(os.getpid(), {int(number)})\n    return answer\n"
            f"{owner}.{name} = stopped\nbacklash_cli.__main__.main()\n")
    ended = subprocess.run([sys.executable, "-c", code, "scan", str(plant), "--no-confirm"], capture_output=True,
                           text=True, timeout=20)
    assert "Traceback" not in ended.stderr
    assert ended.returncode in (128 + number, -number)


@pytest.mark.parametrize("answer", ["time.sleep(60)", "raise AttributeError('half an import')"])
def test_a_stop_that_is_lost_on_its_way_ends_the_process_all_the_same(plant, answer):
    """An exception that lands in a library's callback or import is swallowed there, becomes another, or leaves a lock
    closed."""
    deaf = f"        try:\n            time.sleep(60)\n        except BaseException:\n            {answer}\n"
    code = SLOW.replace("        time.sleep(60)\n", deaf).replace("main()\n", "import backlash_cli.__main__\n"
        "backlash_cli.__main__.PATIENCE = 0.5\nmain()\n")
    running = subprocess.Popen([sys.executable, "-c", code, "scan", str(plant), "--no-confirm"], stdout=subprocess.PIPE,
                               stderr=subprocess.PIPE, text=True)
    assert running.stderr is not None and running.stderr.readline() == "second loop\n"
    running.send_signal(signal.SIGTERM)
    _, err = running.communicate(timeout=20)
    assert running.returncode == 143 and "stopped" in err


@pytest.mark.parametrize("form", ["json", "html"])
def test_a_reader_that_goes_away_is_no_error(plant, form):
    command = f"{subprocess.list2cmdline(COMMAND)} scan {plant} --loop PIC303 --no-confirm --format {form} | head -c 10"
    done = subprocess.run(["bash", "-o", "pipefail", "-c", command], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0 and done.stderr == "" and len(done.stdout) == 10


def test_a_reader_that_goes_away_does_not_change_what_the_status_says(plant):
    command = f"{subprocess.list2cmdline(COMMAND)} scan {plant} --loop PIC303 --no-confirm --fail-on any"
    for form, reader in (("json", "cat >/dev/null"), ("html", "true")):
        line = f"{command} --format {form} | {reader}; exit ${{PIPESTATUS[0]}}"
        done = subprocess.run(["bash", "-c", line], capture_output=True, text=True, timeout=60)
        assert done.returncode == 1 and "Traceback" not in done.stderr


# what Python holds back fails at its exit only
@pytest.mark.parametrize(("form", "buffering"), [
    ("table", ""), ("table", "1"), ("html", ""), ("help", ""), ("help", "1")])
def test_a_full_disk_behind_standard_output(plant, form, buffering):
    if not Path("/dev/full").exists():
        pytest.skip("this system has no /dev/full")
    asked = ["--help"] if form == "help" else ["scan", str(plant), "--loop", "PIC303", "--no-confirm",
                                                    "--format", form]
    with open("/dev/full", "w") as full:
        done = subprocess.run([*COMMAND, *asked], stdout=full, stderr=subprocess.PIPE, text=True,
                              env={**os.environ, "PYTHONUNBUFFERED": buffering})
    assert done.returncode == 2 and "standard output" in done.stderr and "Traceback" not in done.stderr
    assert "Exception" not in done.stderr


@pytest.mark.parametrize("closed", [">&-", "2>&-", ">&- 2>&-"])
def test_closed_outputs_take_nothing_and_hurt_nobody(plant, tmp_path, closed):
    command = f"{subprocess.list2cmdline(COMMAND)} scan {plant} --no-confirm --history {tmp_path / 'h.db'} {closed}"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0 and "Traceback" not in done.stderr and (tmp_path / "h.db").stat().st_size > 10_000


def test_a_full_disk_for_a_file_leaves_the_old_report(plant, tmp_path):
    """The limit on file sizes stands in for a full disk: both fail in the middle of writing."""
    old = tmp_path / "r.html"
    old.write_text("old")
    scan = f"{subprocess.list2cmdline(COMMAND)} scan {plant} --loop PIC303 --no-confirm --output {old}"
    command = f"trap '' XFSZ; ulimit -f 100; {scan}"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, timeout=60)
    assert done.returncode == 2 and "cannot write" in done.stderr and "Traceback" not in done.stderr
    assert files(tmp_path) == {"r.html": b"old"}


def in_terminal(*arguments: str, **environment: str) -> tuple[bytes, int]:
    """Run with standard output and error on a terminal; return what it showed and the status."""
    ours, theirs = pty.openpty()
    env = {**os.environ, "TERM": "xterm-256color", "COLUMNS": "120", **environment}
    running = subprocess.Popen([*COMMAND, *arguments], stdout=theirs, stderr=theirs, stdin=theirs, env=env)
    os.close(theirs)
    shown = b""
    while True:
        try:
            block = os.read(ours, 65536)
        except OSError:  # the other side is closed
            break
        if not block:
            break
        shown += block
    os.close(ours)
    return shown, running.wait(60)


def test_colour_and_progress_on_a_terminal_only(plant):
    shown, status = in_terminal("scan", str(plant), "--no-confirm")
    assert status == 0 and b"\x1b[" in shown and b"scanning" in shown
    shown, status = in_terminal("scan", str(plant), "--no-confirm", "--quiet", NO_COLOR="1")
    assert status == 0 and b"scanning" not in shown and b"\x1b[1;31m" not in shown


def test_a_terminal_that_knows_ascii_only(plant):
    done = process("scan", plant, "--no-confirm", env={**os.environ, "PYTHONIOENCODING": "ascii", "LC_ALL": "C"})
    assert done.returncode == 0 and "PIC303" in done.stdout and "\x1b" not in done.stdout and done.stderr == ""


@pytest.mark.parametrize("arguments", [["--help"], ["--version"], [], ["scan", "--help"], ["scn"]])
def test_help_answers_at_once(arguments):
    """0.2 s where Python with click alone takes 0.1 s, whatever else the machine does meanwhile."""
    def once(command):
        began = time.perf_counter()
        subprocess.run(command, capture_output=True, stdin=subprocess.DEVNULL)
        return time.perf_counter() - began

    took = ((once([*COMMAND, *arguments]), once([sys.executable, "-c", "import click"])) for _ in range(5))
    assert any(own / alone < 3.0 for own, alone in took)


@pytest.mark.parametrize("shell", ["zsh", "fish"])
def test_the_shell_completes_commands(shell):
    assert "_BACKLASH_COMPLETE" in process(env={**os.environ, "_BACKLASH_COMPLETE": f"{shell}_source"}).stdout
    typed = {"COMP_WORDS": "backlash comp", "COMP_CWORD": "comp" if shell == "fish" else "1"}
    done = process(env={**os.environ, "_BACKLASH_COMPLETE": f"{shell}_complete", **typed})
    assert "compare" in done.stdout and "compensate" in done.stdout and "scan" not in done.stdout


def test_an_unexpected_fault_is_one_message(plant, tmp_path):
    script = tmp_path / "faulty.py"
    text = "import backlash_cli.engines.local as a\nimport backlash_cli.__main__ as m\na.analyse = None\nm.main()\n"
    script.write_text(text)
    done = subprocess.run([sys.executable, script, "scan", plant], capture_output=True, text=True)
    assert done.returncode == 2 and "fault of backlash" in done.stderr and "Traceback" not in done.stderr
    debug = subprocess.run([sys.executable, script, "scan", plant], capture_output=True, text=True,
                           env={**os.environ, "BACKLASH_DEBUG": "1"})
    assert "Traceback" in debug.stderr
