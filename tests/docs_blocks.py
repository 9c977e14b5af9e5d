"""The command blocks of a page of docs/, and the output shown below them.

    python -m tests.docs_blocks workbench own-effect     puts the present output into these pages

A shown output may end with a line `...`: then it is the beginning of what the command prints.
"""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
import tempfile
from pathlib import Path

DOCS = Path(__file__).resolve().parents[1] / "docs"
# a block of commands, and perhaps the output shown below it
_BLOCK = re.compile(r"^```sh\n((?:(?!```).*\n)*)```(?:\n\n```text\n((?:(?!```).*\n)*)```)?$", re.MULTILINE)
FILES = {"own-effect": {"python": "slow_draining.py", "toml": "loop.toml"}}
LINES = 14  # of an output that is shown for the first time


def commands(page: str) -> list[tuple[list[list[str]], str | None]]:
    """(the backlash commands of a block, the output shown for the last of them) in the order of the page."""
    found = _BLOCK.findall((DOCS / f"{page}.md").read_text("utf-8"))
    return [(backlash_lines(block), text or None) for block, text in found]


def backlash_lines(block: str) -> list[list[str]]:
    """The arguments of every line of a block that runs backlash."""
    return [shlex.split(line) for line in re.findall(r"^backlash (.+)$", block, re.MULTILINE)]


def first_block(page: str, language: str) -> str:
    """The first fenced block of a language."""
    text = (DOCS / f"{page}.md").read_text("utf-8")
    found = re.search(rf"^```{language}\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
    assert found is not None, f"{page}: no {language} block"
    return found.group(1)


def write_files(page: str, folder: Path) -> None:
    """Save the files that the page tells its reader to save."""
    for language, name in FILES.get(page, {}).items():
        (folder / name).write_text(first_block(page, language), encoding="utf-8")


def refresh(page: str) -> None:
    """Run the page's commands in an empty folder and put what they print now into the page."""
    path = DOCS / f"{page}.md"
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_files(page, folder)

        def present(found: re.Match[str]) -> str:
            block, shown = found.groups()
            out = ""
            for line in backlash_lines(block):
                run = [sys.executable, "-m", "backlash_cli", *line]
                out = subprocess.run(run, cwd=folder, capture_output=True, text=True, check=True).stdout
            if shown is None:
                return found.group()
            count = len(shown.splitlines()) - 1 if shown else LINES
            lines = out.splitlines()
            kept = [*lines[:count], "..."] if count < len(lines) else lines
            return f"```sh\n{block}```\n\n```text\n" + "\n".join(kept) + "\n```"

        text = _BLOCK.sub(present, path.read_text("utf-8"))
        for picture in folder.glob("*.png"):
            (DOCS / "pictures").mkdir(exist_ok=True)
            (DOCS / "pictures" / f"{page}-{picture.name}").write_bytes(picture.read_bytes())
    path.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    for name in sys.argv[1:]:
        refresh(name)
