"""The command, on the sample plant."""

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from backlash_cli.__main__ import cli
from backlash_cli.errors import BacklashError

PLANT = str(Path(__file__).parents[2] / "sample_data" / "plant.csv")


def run(*arguments):
    return CliRunner().invoke(cli, ["compensate", PLANT, *arguments])


def test_advice_text_page_and_numbers(tmp_path):
    page, numbers = tmp_path / "advice.html", tmp_path / "advice.json"
    result = run("--loop", "FIC101", "--dead-band", "3%", "--html", str(page), "--json", str(numbers))
    assert result.exit_code == 0, result.output
    assert "advice to a person" in result.stdout
    document = json.loads(numbers.read_text())
    assert 0.0 < document["recommended"]["gain"] < 0.03
    assert "FIC101" in page.read_text(encoding="utf-8")


def test_numbers_on_standard_output_with_a_given_process():
    result = run("--loop", "FIC101", "--dead-band", "0.03", "--process", "K=1.3,T=20,T2=2", "--json", "-")
    assert json.loads(result.stdout)["process"]["source"] == "given"


@pytest.mark.parametrize("arguments", [
    ("--loop", "FIC1"), ("--loop", "FIC101", "--dead-band", "x"), ("--loop", "FIC101", "--process", "T=-1"),
    ("--loop", "LIC404", "--dead-band", "4%"),
])
def test_what_cannot_be_is_one_message_with_a_remedy(arguments):
    result = run(*arguments)
    assert isinstance(result.exception, BacklashError)
    assert result.exception.remedy
