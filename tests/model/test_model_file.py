"""The model file: written and read back the same, every mistake named with file, line and the nearest known name."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from backlash_cli.errors import MetadataError
from backlash_cli.model.saved_model import model_text, parse_model
from backlash_cli.results import Model, ModelEffect

MODEL = Model(
    "FIC101", Kp=1.3, tau=20.5, offset=-0.05, theta=2.0,
    effects=(
        ModelEffect("backlash", {"d": 0.031, "position": -0.4}),
        ModelEffect("load_step", {"times": (100.0, 250.5), "sizes": (0.02, -0.01)}),
        ModelEffect("measured_disturbance", {"gain": -0.006}, column="DV 1"),
    ),
    start=1773734400.0, end=1773745200.0, interval=1.0, pv_range=(0.0, 900.0), op_range=(0.0, 100.0),
    rmse_holdout=0.003,
)
TEXT = """# mine
loop = "FIC101"

[baseline]
Kp = 1.3
tau = 20.0

[[effects]]
effect = "backlash"
d = 0.03

[[effects]]
effect = "stiction"
S = 0.05
J = 0.02
"""

finite = st.floats(-1e6, 1e6).map(lambda x: float(f"{x:.8g}"))


def test_a_model_comes_back_as_it_was_and_says_what_its_numbers_are():
    text = model_text(MODEL)
    assert parse_model(text) == MODEL
    assert "start = 2026-03-17T08:00:00Z" in text and "d = 0.031  # dead band [span]" in text
    assert "# Play in the valve linkage" in text


@given(st.text(min_size=1), finite.filter(bool), st.floats(1e-3, 1e6), finite, st.floats(0, 0.5), st.text())
def test_any_names_and_numbers_come_back(loop, gain, tau, offset, d, column):
    effects = (
        ModelEffect("backlash", {"d": float(f"{d:.8g}")}),
        ModelEffect("measured_disturbance", {"gain": gain}, column or "x"),
    )
    model = Model(loop, Kp=gain, tau=float(f"{tau:.8g}"), offset=offset, effects=effects)
    back = parse_model(model_text(model))
    without_zeros = tuple(replace(e, parameters={k: v for k, v in e.parameters.items() if v}) for e in effects)
    assert back == replace(model, effects=without_zeros)


def test_a_short_file_by_hand_is_enough():
    model = parse_model(TEXT)
    assert [e.effect for e in model.effects] == ["backlash", "stiction"]
    assert model.theta == 0.0 and model.pv_range is None and model.effects[1].parameters == {"S": 0.05, "J": 0.02}


@pytest.mark.parametrize(("old", "new", "line", "said"), [
    ("loop =", "lop =", 2, "unknown key 'lop' -> did you mean loop"),
    ('loop = "FIC101"', "", None, "loop is missing"),
    ("tau = 20.0", "tua = 20.0", 6, "unknown key 'tua' -> did you mean tau"),
    ("tau = 20.0", "", 4, "tau is missing -> add tau"),
    ("tau = 20.0", "tau = -3", 6, "tau = -3 is not possible -> give one number: time constant [s]"),
    ("tau = 20.0", "tau = '20'", 6, "tau = '20' is not possible -> give one number"),
    ("tau = 20.0", "tau = 20.0\ntheta = -1", 7, "theta = -1 is not possible"),
    ('loop = "FIC101"', "[loops.FIC101]", 2, "settings of loops are no model: give them to --loops"),
    ("Kp = 1.3", "Kp = 0", 5, "with Kp = 0 OP moves nothing"),
    ('loop = "FIC101"', 'loop = "FIC101"\nstart = 2026-03-02T08:00:00Z\nend = 2026-03-02T06:00:00Z', 4,
     "end lies before start"),
    ("tau = 20.0", "tau = 20.0 s", 6, "not valid TOML"),
    ('"backlash"', '"backlsh"', 9, "no effect 'backlsh' -> did you mean backlash"),
    ('"stiction"', "3", 12, "names no effect"),
    ("d = 0.03", "D2 = 0.03", 10, "unknown key 'D2' of backlash -> did you mean d?"),
    ("d = 0.03", "d = 3.0", 10, "d = 3.0: 3 is not possible -> dead band [span], 0 to 0.5"),
    ("d = 0.03", "d = [0.1, 0.2]", 10, "is not one number"),
    ("d = 0.03", "d = true\nposition = 'x'", 10, ""),
    ("S = 0.05", "S = 'wide'", 14, "is not a number"),
    ("Kp = 1.3", "Kp = inf", 5, "Kp = inf is not possible"),
    ("# mine", "pv_range = [3, 1]", 1, "pv_range must rise"),
    ("# mine", "start = 'noon'", 1, "start = 'noon' is not possible -> write start = 2026"),
    ("# mine", "effects = 3", None, ""),
])
def test_a_mistake_names_the_line_and_the_remedy(old, new, line, said):
    with pytest.raises(MetadataError) as caught:
        parse_model(TEXT.replace(old, new), "m.toml")
    assert said in str(caught.value)
    if line is not None:
        assert caught.value.where == f"m.toml, line {line}"


def test_lists_of_different_length_and_a_missing_column():
    with pytest.raises(MetadataError, match="times and sizes differ in length"):
        parse_model(TEXT + '[[effects]]\neffect = "load_step"\ntimes = [1.0, 2.0]\nsizes = [0.1]\n')
    with pytest.raises(MetadataError, match="needs the name of a measured column"):
        parse_model(TEXT + '[[effects]]\neffect = "measured_disturbance"\ngain = 0.1\n')


@given(st.text())
def test_no_text_ends_in_anything_but_a_model_or_a_message(text):
    for given_text in (text, TEXT + text, TEXT.replace("0.03", text)):
        try:
            parse_model(given_text)
        except MetadataError:
            continue
