"""The README's fenced blocks, for the tests and for .ci/run.

    python -m tests.readme_blocks sh 1        prints the first block of shell commands
    python -m tests.readme_blocks same FILE   fails unless FILE ends with the first output that the README shows
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


_NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?")


def same(shown: str, said: str, tolerance: float = 0.1) -> bool:
    """Whether two texts say the same, spaces aside, numbers within a tenth: another processor rounds otherwise."""
    shown, said = " ".join(shown.split()), " ".join(said.split())
    if _NUMBER.sub("#", shown) != _NUMBER.sub("#", said):
        return False
    pairs = zip(_NUMBER.findall(shown), _NUMBER.findall(said), strict=True)
    return all(abs(float(a) - float(b)) <= tolerance * abs(float(a)) + 0.02 for a, b in pairs)


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
    elif sys.argv[1] == "same":
        promised, printed = blocks("text")[0], Path(sys.argv[2]).read_text("utf-8")
        tail = "\n".join(printed.splitlines()[-len(promised.splitlines()) :])
        if not same(promised, tail):
            sys.exit(f"the README promises another output than this:\n{printed}")
    else:
        sys.stdout.write(blocks(sys.argv[1])[int(sys.argv[2]) - 1])
