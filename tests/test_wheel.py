"""Whatever lies in the package is in the wheel that `pip wheel --no-deps .` builds: templates, scenarios, limits."""

import tomllib
from pathlib import Path

import backlash_cli

PACKAGE = Path(backlash_cli.__file__).parent
PROJECT = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text("utf-8"))


def test_every_file_of_the_package_is_shipped():
    patterns = PROJECT["tool"]["setuptools"]["package-data"]["backlash_cli"]
    shipped = {path for pattern in patterns for path in PACKAGE.glob(pattern)}
    there = {path for path in PACKAGE.rglob("*") if path.is_file() and "__pycache__" not in path.parts}
    assert {path for path in there if path.suffix != ".py"} == shipped - {path for path in shipped if path.is_dir()}
    assert {path.name for path in shipped} >= {
        "py.typed", "limits.toml", "published.toml", "words.toml", "sample-plant.toml"}


def test_every_module_is_in_a_package_that_setuptools_finds():
    assert PROJECT["tool"]["setuptools"]["packages"]["find"]["include"] == ["backlash_cli*"]
    folders = {path.parent for path in PACKAGE.rglob("*.py")}
    assert all((folder / "__init__.py").exists() for folder in folders)
