"""What a reader of the project must never meet: unfinished work, paths of somebody's machine, private addresses."""

import ast
import re
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
TEXT = {".py", ".md", ".toml", ".html", ".css", ".js", ".txt", ".cfg", ".yml", ".yaml", ".sh", ""}
# put together from pieces, so that this file does not find itself
UNFINISHED = re.compile("|".join(["TO" + "DO", "FIX" + "ME", r"\bX" + r"XX\b", "HA" + r"CK\b"]))
_PLACES = "|".join(["wo" + "rk", "ro" + "ot", "ho" + r"me/\w+", "Us" + r"ers/\w+"])
MACHINE = re.compile(rf"(?<![\w.])/(?:{_PLACES})/\w")
ADDRESS = re.compile(r"https?://(?:127\.|10\.|192\.168\.|172\.(?:1[6-9]|2\d|3[01])\.|\[?::1)[\w.:]*")


def project_files() -> list[Path]:
    try:
        listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("the project's files are listed by git, and this is no git checkout")
    return [ROOT / name for name in listed.splitlines() if (ROOT / name).is_file()]


def texts() -> list[tuple[Path, list[str]]]:
    chosen = [p for p in project_files() if p.suffix in TEXT and p.stat().st_size < 2_000_000]
    return [(p, p.read_text("utf-8", "replace").splitlines()) for p in chosen]


@pytest.mark.parametrize("words", [UNFINISHED, MACHINE, ADDRESS], ids=["unfinished", "machine", "address"])
def test_nothing_unfinished_and_no_private_place(words):
    found = [f"{p.relative_to(ROOT)}:{i}: {m.group()}" for p, lines in texts() for i, line in enumerate(lines, 1)
             for m in [words.search(line)] if m]
    assert not found, "\n".join(found)


def test_no_stub_functions_in_the_package():
    """A function whose body says nothing but `pass`, `...` or NotImplementedError promises what is not there."""
    found, nothing = [], [ast.dump(n) for n in ast.parse("pass\n...").body]
    for path in project_files():
        if path.suffix != ".py" or "backlash_cli" not in path.parts:
            continue
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.Raise) and node.exc is not None and "NotImplemented" in ast.dump(node.exc):
                found.append(f"{path.name}:{node.lineno}")
            if isinstance(node, ast.ClassDef) and any("Protocol" in ast.unparse(b) for b in node.bases):
                node.body = []  # a protocol's methods have no body by design
            if isinstance(node, ast.FunctionDef):
                body = [n for n in node.body if not (isinstance(n, ast.Expr) and isinstance(n.value, ast.Constant)
                                                     and isinstance(n.value.value, str))]
                if body and all(ast.dump(n) in nothing for n in body):
                    found.append(f"{path.name}:{node.lineno} {node.name}")
    assert not found, found


def test_sample_data_stay_small():
    size = sum(p.stat().st_size for p in project_files() if "sample_data" in p.parts)
    assert size < 10_000_000
