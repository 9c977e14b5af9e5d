"""Run the command line as a user does: in this process for speed, or as its own process for signals and pipes."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from backlash_cli import __main__ as command_line

COMMAND = [sys.executable, "-m", "backlash_cli"]


@dataclass(frozen=True)
class Done:
    status: int
    out: str
    err: str


def run(capfd: pytest.CaptureFixture[str], *arguments: object) -> Done:
    """Run in this process; `capfd` catches both streams.

    Stops are not listened for: each time would leave a waiting thread and two open pipes in the tests' own process.
    """
    capfd.readouterr()
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(command_line, "_hear_stops", lambda: None)
        status = command_line._guarded([str(a) for a in arguments])
    out, err = capfd.readouterr()
    assert "Traceback" not in out + err
    return Done(status, out, err)


def process(*arguments: object, **options: Any) -> subprocess.CompletedProcess[str]:
    """Run as a process of its own."""
    command = [*COMMAND, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, stdin=subprocess.DEVNULL, **options)


def files(folder: Path) -> dict[str, bytes]:
    """Every file below a folder with its content."""
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}
