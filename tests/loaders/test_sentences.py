"""The catalogue of sentences in words.toml: each is used, and none is missing."""

import ast
from pathlib import Path

import pytest

from backlash_cli import words
from backlash_cli.loaders import names

CODE = [ast.parse(path.read_text("utf-8")) for path in sorted(Path(names.__file__).parent.glob("*.py"))]
TEXTS = {node.value for tree in CODE for node in ast.walk(tree)
         if isinstance(node, ast.Constant) and isinstance(node.value, str)}
CALLS = [(node.func.id, node.args[0].value) for tree in CODE for node in ast.walk(tree)
         if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in ("explained", "noted")
         and isinstance(node.args[0], ast.Constant)]
OF_SAMPLES = {code for _, code in words.WORDS["samples"].values() if code}


def test_every_sentence_that_is_asked_for_is_there():
    kinds = {"explained": "errors", "noted": "notes"}
    assert len(CALLS) > 80
    assert [name for function, name in CALLS if name not in names.WORDS[kinds[function]]] == []
    assert words.WORDS["notes"].keys() >= OF_SAMPLES


@pytest.mark.parametrize("kind", ["errors", "notes"])
def test_no_sentence_is_left_that_nobody_says(kind):
    by_option = {"expanded:hold", "expanded:linear"}  # the interpolation that was asked for
    assert names.WORDS[kind].keys() - TEXTS - by_option == set()


def test_errors_say_how_they_are_mended():
    errors = names.WORDS["errors"] | words.WORDS["errors"]
    assert [name for name, (what, remedy, *_) in errors.items() if not what or not remedy] == []


def test_every_expression_is_used_and_none_is_missing():
    used = {node.attr for tree in CODE for node in ast.walk(tree)
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "FORM"}
    assert len(used) > 30 and used == vars(names.FORM).keys()
