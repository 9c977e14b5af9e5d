"""The sentences of words.toml: shares shown in per cent, every code known, every sentence said somewhere."""

import ast
from pathlib import Path

import backlash_cli
from backlash_cli.words import WORDS, noted, said, times

PACKAGE = Path(backlash_cli.__file__).parent
# codes put together where they are said: the kind of a thing behind the colon, or a word that a loop gets
MADE = ("guessed_", "output_compressed:", "of_output:", "manual_test:", "vote:", "gain:")


def codes() -> set[str]:
    """All texts that stand in the package's own code."""
    trees = (ast.parse(path.read_text("utf-8")) for path in PACKAGE.rglob("*.py"))
    values = (getattr(node, "value", None) for tree in trees for node in ast.walk(tree))
    return {value for value in values if isinstance(value, str)}


def test_a_share_is_shown_in_per_cent_and_the_values_are_kept():
    note = noted("output_rounded", {"effect": "info", "step": 0.005, "limit": 0.0125})
    assert note.message == "OP is rounded to 0.5 %: dead bands below 1.25 % cannot be seen in it"
    assert note.code == "output_rounded" and note.values["step"] == 0.005
    assert noted("insufficient_data:settings", used=3).code == "insufficient_data"
    assert said("manual_test:trace", d=0.021) == "there is no more than a trace of a dead band of 2.1 %"
    assert [times(n) for n in (0, 1, 2, 3)] == ["not once", "once", "twice", "3 times"]


def test_every_sentence_is_said_somewhere():
    known = codes() | {code for _, code in WORDS["samples"].values()}
    assert not [code for code in WORDS["notes"] if code not in known and not code.startswith(MADE)]


def test_every_code_that_is_said_has_its_sentence():
    for path in PACKAGE.rglob("*.py"):
        if "loaders" in path.parts:  # has sentences of its own
            continue
        for call in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(call, ast.Call) and getattr(call.func, "id", "") in ("noted", "said") and call.args:
                first = call.args[0]
                for code in [first.body, first.orelse] if isinstance(first, ast.IfExp) else [first]:
                    if isinstance(code, ast.Constant):
                        assert code.value in WORDS["notes"], f"{path.name}: {code.value}"
