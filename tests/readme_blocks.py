"""The README's fenced blocks, for the tests and for .ci/run.

    python -m tests.readme_blocks sh 1        prints the first block of shell commands
    python -m tests.readme_blocks refresh     puts the present output of its commands and programs into the README
"""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
README = ROOT / "README.md"
# a block of commands or of Python, and the output shown below it
_SHOWN = re.compile(r"^```(sh|python)\n((?:(?!```).*\n)*)```\n\n```text\n((?:(?!```).*\n)*)```$", re.MULTILINE)


def blocks(language: str) -> list[str]:
    """Contents of the fenced blocks of a language (sh, text, python), in order."""
    return re.findall(rf"^```{language}\n(.*?)^```$", README.read_text("utf-8"), re.MULTILINE | re.DOTALL)


def shown() -> list[tuple[str, str, str]]:
    """(language, block, output shown below it) where the README shows an output."""
    return _SHOWN.findall(README.read_text("utf-8"))


def backlash_lines(block: str) -> list[list[str]]:
    """The arguments of every line of a block that runs backlash."""
    found = re.findall(r"^(?:\.venv/bin/)?backlash (.+)$", block.replace("\\\n", " "), re.MULTILINE)
    return [shlex.split(line, comments=True) for line in found]


def output(language: str, block: str) -> str:
    """What a Python block, or the last line of a shell block that runs backlash, prints now."""
    command = ["-c", block] if language == "python" else ["-m", "backlash_cli", *backlash_lines(block)[-1]]
    done = subprocess.run([sys.executable, *command], cwd=ROOT, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0 and not done.stderr, done.stderr
    return done.stdout


def refresh() -> None:
    """Replace every shown output by the present one."""

    def present(found: re.Match[str]) -> str:
        language, block, _ = found.groups()
        return f"```{language}\n{block}```\n\n```text\n{output(language, block)}```"

    README.write_text(_SHOWN.sub(present, README.read_text("utf-8")), encoding="utf-8")


if __name__ == "__main__":
    if sys.argv[1:] == ["refresh"]:
        refresh()
    else:
        sys.stdout.write(blocks(sys.argv[1])[int(sys.argv[2]) - 1])
