"""The house has one direction: a sample goes from the files to the report, and no room imports from a room before it.

Read from the source with `ast`, imports within functions included (`if TYPE_CHECKING` blocks apart).
"""

import ast
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pa_parquet
import pytest

import backlash_cli

PACKAGE = Path(backlash_cli.__file__).parent
BASE = {"errors", "record", "results", "kernels", "toml_text", "words", "_version"}
# room -> rooms it may use besides itself and BASE
ALLOWED = {
    "errors": set(),
    "_version": set(),
    "record": {"errors"},
    "results": {"errors", "record"},
    "kernels": set(),
    "toml_text": {"errors", "places"},
    "scratch": set(),
    "words": {"record"},
    "samples": set(),
    "selection": set(),
    "places": set(),
    "half_periods": set(),
    "estimator": {"half_periods"},
    "scanning": {"estimator", "half_periods", "model"},
    "check": {"estimator"},
    "effects": set(),
    "model": {"effects", "estimator"},
    "simulator": {"effects", "estimator", "model", "scanning"},
    "settings": set(),
    "loaders": {"places", "samples", "scratch", "selection", "settings"},
    "reporter": set(),
    "history": {"estimator", "scanning", "selection"},
    "plan": {"effects", "estimator", "scanning", "simulator"},
    "engines": {"loaders", "scanning", "history"},
    "api": {"engines", "loaders", "settings", "scanning", "model", "simulator", "history", "reporter"},
    "commands": {
        "api", "check", "engines", "loaders", "places", "scanning", "estimator", "model", "plan", "simulator",
        "effects", "history", "reporter",
    },
    "__main__": {"commands", "reporter"},
    "__init__": {"api", "loaders", "scanning", "model", "simulator", "effects", "reporter", "history"},
}
# foreign library -> the rooms that may use it
HOMES = {
    "click": {"commands", "__main__"},
    "rich": {"commands", "reporter"},
    "pandas": {"loaders", "history", "reporter"},
    "pyarrow": {"loaders", "history", "reporter"},
    "plotly": {"reporter"},
    "matplotlib": {"reporter"},
    "jinja2": {"reporter"},
    "sqlite3": {"history"},
    "fsspec": {"places"},
    "dask": {"engines"},
    "distributed": {"engines"},
}
CORE = BASE | {
    "samples", "half_periods", "estimator", "scanning", "effects", "model", "plan", "simulator",
}
NOT_IN_CORE = {"print", "open", "input"}


def modules() -> list[Path]:
    return sorted(PACKAGE.rglob("*.py"))


def room(path: Path) -> str:
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def type_checking_lines(tree: ast.Module) -> set[int]:
    found: set[int] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test):
            found.update(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    return found


def imports(path: Path) -> list[tuple[int, str]]:
    """(line, dotted name) of every import, relative ones made absolute."""
    tree = ast.parse(path.read_text("utf-8"))
    skipped = type_checking_lines(tree)
    parts = ("backlash_cli", *path.relative_to(PACKAGE).parts[:-1])
    found = []
    for node in ast.walk(tree):
        if getattr(node, "lineno", 0) in skipped:
            continue
        if isinstance(node, ast.Import):
            found += [(node.lineno, alias.name) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = ".".join(parts[: len(parts) - node.level + 1]) if node.level else ""
            name = ".".join(p for p in (base, node.module) if p)
            found += [(node.lineno, f"{name}.{alias.name}") for alias in node.names]
    return found


@pytest.mark.parametrize("path", modules(), ids=lambda p: str(p.relative_to(PACKAGE)))
def test_imports_go_one_way(path):
    here = room(path)
    assert here in ALLOWED, f"{here} has no place in the layout yet: add it to ALLOWED with what it may use"
    for line, name in imports(path):
        parts = name.split(".")
        if parts[0] == "backlash_cli" and len(parts) > 1:
            # `from . import x` in the package itself names rooms only where a module of that name exists
            target = parts[1]
            if (PACKAGE / target).is_dir() or (PACKAGE / f"{target}.py").exists():
                known = ALLOWED[here] | BASE | {here}
                assert target in known, f"{path.name}:{line} imports {name}; {here} may use {sorted(known)}"
        elif parts[0] in HOMES:
            assert here in HOMES[parts[0]], f"{path.name}:{line}: {parts[0]} belongs in {sorted(HOMES[parts[0]])}"


@pytest.mark.parametrize("path", [p for p in modules() if room(p) in CORE], ids=lambda p: str(p.relative_to(PACKAGE)))
def test_the_core_prints_nothing_opens_nothing_and_has_no_clock(path):
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.Call):
            called = ast.unparse(node.func)
            assert called not in NOT_IN_CORE, f"{path.name}:{node.lineno} calls {called}"
            assert not called.startswith(("time.", "np.random.seed", "random.seed", "datetime.now")), (
                f"{path.name}:{node.lineno} calls {called}"
            )
            seeded = ("np.random.default_rng", "np.random.Generator", "np.random.SeedSequence")
            if called.startswith("np.random.") and not called.startswith(seeded):
                pytest.fail(f"{path.name}:{node.lineno}: {called} uses the global random state")


def loaded_by(code: str) -> set[str]:
    script = f"import sys\n{code}\nprint(' '.join(sys.modules))"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    return set(done.stdout.split())


def test_the_package_and_its_help_load_nothing_heavy():
    code = "from backlash_cli.__main__ import cli\ncli.main(['--help'], standalone_mode=False)"
    heavy = {"numpy", "pandas", "pyarrow", "scipy", "numba", "plotly", "matplotlib", "jinja2", "rich"}
    assert not heavy & loaded_by(code)
    assert not heavy & loaded_by("import backlash_cli")


def test_reading_a_result_as_json_needs_no_pandas():
    assert "pandas" not in loaded_by("from backlash_cli import to_json, ScanResult; to_json(ScanResult(()))")


def test_a_scan_of_numbers_and_stamps_starts_without_pandas(tmp_path):
    """It takes as long to load as fifty loops to analyse, in each process; compiled loops serve PV against OP.

    One process scans both kinds of files, first without the confirmation: what is loaded only grows.
    """
    rows = 600
    stamps = np.datetime64("2026-03-17T00:00:00", "ms") + 1000 * np.arange(rows)
    noise = np.random.default_rng(0).normal(50.0, 1.0, rows)
    table = pa.table({"time": stamps, "FIC101.SP": np.full(rows, 50.0), "FIC101.PV": noise, "FIC101.OP": 100.0 - noise})
    pa_parquet.write_table(table, tmp_path / "plant.parquet")
    pa_csv.write_csv(table, tmp_path / "plant.csv")
    (tmp_path / "loops.toml").write_text("[defaults]\nK = 0.8\nTi = 5.0\npv_range = [0, 100]\nop_range = [0, 100]\n")
    loaded = loaded_by("import backlash_cli as b\n"
                       "for confirm in (False, True):\n"
                       "    for ending in ('parquet', 'csv'):\n"
                       f"        path = {str(tmp_path)!r} + '/plant.' + ending\n"
                       "        found = b.scan_files(path, options=b.ScanOptions(confirm=confirm))\n"
                       "        loaded = {'pandas', 'numba', 'scipy.signal'} & {*sys.modules}\n"
                       "        print(f'{ending}:{found.loops[0].samples}', *(f'{confirm}:{x}' for x in loaded))")
    assert {"csv:600", "parquet:600"} <= loaded and "pandas" not in loaded
    assert {word for word in loaded if word.startswith(("False:", "True:"))} == {
        "False:scipy.signal", "True:scipy.signal", "True:numba"}


def test_public_names_exist_and_stay_what_they_are():
    for name in backlash_cli.__all__:
        assert getattr(backlash_cli, name) is not None, name
    from backlash_cli import scan

    assert callable(scan) and scan.__module__ == "backlash_cli.api"
    with pytest.raises(AttributeError, match="attribute skan"):
        _ = backlash_cli.skan
