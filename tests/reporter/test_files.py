"""A report is there whole or not at all."""

import errno
import os
import signal
import stat
import subprocess
import sys
import time
from pathlib import Path

import pytest

from backlash_cli.errors import BacklashError
from backlash_cli.reporter import files
from backlash_cli.reporter.files import replacing, write_text


def only(folder: Path) -> list[str]:
    return sorted(p.name for p in folder.iterdir())


def test_writes_utf8_and_replaces(tmp_path):
    path = tmp_path / "r.txt"
    write_text(path, "old")
    write_text(path, "Süd \udc80")
    assert path.read_bytes() == "Süd \\udc80".encode()
    assert only(tmp_path) == ["r.txt"]


@pytest.mark.parametrize("stop", [KeyboardInterrupt, RuntimeError, SystemExit])
def test_a_stop_in_the_middle_keeps_the_old_report(tmp_path, stop):
    path = tmp_path / "r.txt"
    write_text(path, "old")
    with pytest.raises(stop), replacing(path) as temporary:
        temporary.write_text("half")
        raise stop
    assert path.read_text() == "old" and only(tmp_path) == ["r.txt"]


@pytest.mark.parametrize(
    ("number", "words"),
    [(errno.ENOSPC, "disk is full"), (errno.EROFS, "read-only"), (errno.EACCES, "no permission"), (errno.EIO, "error")],
)
def test_disk_errors_are_named_and_leave_the_old_report(tmp_path, monkeypatch, number, words):
    path = tmp_path / "r.txt"
    write_text(path, "old")

    def fail(*_: object) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(files, "_flush", fail)
    with pytest.raises(BacklashError, match=words) as caught:
        write_text(path, "new")
    assert caught.value.code == "cannot_write" and caught.value.remedy
    assert path.read_text() == "old" and only(tmp_path) == ["r.txt"]


def test_missing_folder_folder_as_file_and_file_as_folder(tmp_path):
    (tmp_path / "file").write_text("x")
    for path, words in (
        (tmp_path / "no" / "r.txt", "does not exist"),
        (tmp_path, "this is a folder"),
        (tmp_path / "file" / "r.txt", "not a folder"),
        (tmp_path / ("x" * 300), "too long"),
    ):
        with pytest.raises(BacklashError, match=words):
            write_text(path, "new")
    assert only(tmp_path) == ["file"]


def test_rights_of_the_old_file_stay_and_new_ones_follow_the_umask(tmp_path):
    old, new = tmp_path / "old", tmp_path / "new"
    old.write_text("x")
    old.chmod(0o640)
    before = os.umask(0o027)
    try:
        write_text(old, "y")
        write_text(new, "y")
    finally:
        os.umask(before)
    assert stat.S_IMODE(old.stat().st_mode) == 0o640
    assert stat.S_IMODE(new.stat().st_mode) == 0o640


def test_a_link_is_followed(tmp_path):
    (tmp_path / "real").write_text("old")
    (tmp_path / "link").symlink_to("real")
    write_text(tmp_path / "link", "new")
    assert (tmp_path / "link").is_symlink() and (tmp_path / "real").read_text() == "new"


def test_a_device_is_written_and_not_replaced():
    write_text("/dev/null", "x")
    assert stat.S_ISCHR(os.stat("/dev/null").st_mode)


def test_full_disk_for_real():
    if not Path("/dev/full").exists():
        pytest.skip("this system has no /dev/full")
    with pytest.raises(BacklashError, match="disk is full"):
        write_text("/dev/full", "x")


WRITER = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell without job control starts its children deaf to it
from backlash_cli.reporter.files import write_text
content = [chr(65 + k) * 4_000_000 for k in range(8)]
print("ready", flush=True)
while True:
    for block in content:
        write_text(sys.argv[1], block)
"""


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGINT])
def test_killed_at_any_moment_leaves_one_whole_report(tmp_path, how):
    path = tmp_path / "r.bin"
    for k in range(8):
        process = subprocess.Popen(
            [sys.executable, "-c", WRITER, str(path)], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
        )
        assert process.stdout is not None and process.stdout.readline() == b"ready\n"
        time.sleep(0.005 + 0.011 * k)
        process.send_signal(how)
        process.communicate()
        if path.exists():
            content = path.read_bytes()
            assert len(content) == 4_000_000 and len(set(content)) == 1
    assert path.exists()
    if how is signal.SIGINT:
        assert only(tmp_path) == ["r.bin"]


def test_what_a_killed_run_left_goes_after_a_day(tmp_path):
    mine, young = tmp_path / ".backlash-0123456789ab.tmp", tmp_path / ".backlash-ba9876543210.tmp"
    others = [tmp_path / name for name in (".backlash-mine.tmp", "backlash-0123456789ab.tmp", ".backlash-0123456789ab")]
    for path in (mine, young, *others):
        path.write_text("")
        os.utime(path, (time.time() - 2 * 86400,) * 2)
    os.utime(young)
    write_text(tmp_path / "report.json", "{}")
    assert sorted(tmp_path.iterdir()) == sorted([young, *others, tmp_path / "report.json"])


def test_a_pipe_is_written_straight():
    done = subprocess.run([sys.executable, "-c", "from backlash_cli.reporter.files import write_text\n"
                           "write_text('/dev/stdout', 'through a pipe')"], capture_output=True, text=True)
    assert done.stdout == "through a pipe", done.stderr
