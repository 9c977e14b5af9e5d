"""Window sums and the fit on them against one row and one window after the other."""

import numpy as np
import pytest

from backlash_cli.estimator.control_law import LawFit, LawForm, LawRows, fit_law, window_sums


def by_hand(signals: np.ndarray, index: np.ndarray, h: float, Tf: float, form: LawForm) -> np.ndarray:
    """The terms of each window as a matrix, and its centred products."""
    a, parts, rows = np.exp(-h / Tf) if Tf else 0.0, [], []
    for k in range(len(index)):
        if k == 0 or index[k] != index[k - 1] + 1:
            parts, rows, since, integral = [*parts, rows], [], 0, 0.0
            first = second = signals[1, k]
        else:
            since += 1
        late = k - form.shift if since >= form.shift else k
        before = second
        first = a * first + (1 - a) * signals[1, late]
        second = a * second + (1 - a) * first
        error = signals[0, late] - second
        integral += h * error
        if since >= form.settle:
            rows.append([signals[2, k], -second, integral - form.phase * h * error, signals[0, late],
                         -(second - before) / h])
            if len(rows) == form.window:
                parts, rows = [*parts, rows], []
    windows = [np.array(part) for part in (*parts, rows) if 2 * len(part) >= form.window]
    return np.array([(x - x.mean(0)).T @ (x - x.mean(0)) for x in windows])


@pytest.mark.parametrize(("shift", "phase", "window", "settle"), [(0, 0.0, 20, 3), (1, 0.25, 37, 0), (2, 0.5, 41, 10)])
@pytest.mark.parametrize("Tf", [0.0, 0.4, 2.0])
def test_sums_are_those_of_the_rows_one_by_one(shift, phase, window, settle, Tf):
    rng = np.random.default_rng(window)
    index = np.cumsum(rng.choice([1, 4], size=700, p=[0.99, 0.01])).astype(np.int64)
    signals = np.cumsum(rng.normal(size=(3, 700)), axis=1)
    form = LawForm((1, 2, 3), window, settle, shift, phase)
    sums, expected = window_sums(LawRows(index, signals, 0.5), form, Tf), by_hand(signals, index, 0.5, Tf, form)
    assert sums.shape == expected.shape and len(sums) > 8
    np.testing.assert_allclose(sums, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


def test_windows_in_which_the_output_stands_still_are_left_out():
    signals = np.cumsum(np.random.default_rng(1).normal(size=(3, 200)), axis=1)
    signals[2, 40:80] = 0.1
    rows = LawRows(np.arange(200), signals, 1.0)
    assert len(window_sums(rows, LawForm((1, 2), 20, 0), 0.0)) == 8
    assert len(window_sums(rows, LawForm((1, 2), 20, 195), 0.0)) == 0


def rows_of(windows: int, odd: int | None = None) -> tuple[LawRows, LawForm]:
    """Windows of 30 rows whose output is made of the terms and noise; in one of them by something else."""
    rng = np.random.default_rng(windows)
    n = 30 * windows
    signals = np.cumsum(rng.normal(size=(3, n)), axis=1)
    error = signals[0] - signals[1]
    signals[2] = -0.8 * signals[1] + 0.03 * np.cumsum(error) + 0.2 * signals[0] + 0.1 * rng.normal(size=n)
    if odd is not None:
        signals[2, 30 * odd : 30 * odd + 30] += 30.0 * rng.normal(size=30)
    return LawRows(np.arange(n), signals, 1.0), LawForm((1, 2, 3), 30, 0)


@pytest.mark.parametrize("windows", [2, 5, 40])
def test_the_fit_is_least_squares_with_weights_that_follow_from_what_is_left(windows):
    rows, form = rows_of(windows)
    fit, sums = fit_law(rows, form), window_sums(rows, form, 0.0)
    assert fit is not None
    if windows < 6:
        expected = np.linalg.solve(sums.sum(0)[1:4, 1:4], sums.sum(0)[1:4, 0])
        np.testing.assert_allclose(fit.values, expected, rtol=1e-9)
        assert fit.unexplained == pytest.approx(fit.residuals.sum() / sums[:, 0, 0].sum())
        return
    np.testing.assert_allclose(fit.values, [0.8, 0.03, 0.2], atol=0.02)
    np.testing.assert_allclose(fit.weights, 2.0 / (1.0 + fit.residuals / np.median(fit.residuals)), rtol=1e-9)
    rest = [s[0, 0] - 2 * s[0, 1:4] @ fit.values + fit.values @ s[1:4, 1:4] @ fit.values for s in sums]
    np.testing.assert_allclose(fit.residuals, rest, rtol=1e-6)
    assert fit.unexplained == pytest.approx(fit.weights @ fit.residuals / (fit.weights @ sums[:, 0, 0]))


def test_a_window_that_something_else_moved_loses_its_weight():
    fit = fit_law(*rows_of(40, odd=7))
    assert fit is not None and fit.weights[7] < 0.01 * np.median(fit.weights)
    np.testing.assert_allclose(fit.values, [0.8, 0.03, 0.2], atol=0.02)


def test_terms_that_cannot_be_told_apart_are_refused():
    rows, form = rows_of(20)
    rows.signals[0] = 0.5  # a setpoint that stands still
    assert fit_law(rows, form) is None
    assert fit_law(rows, LawForm((1, 2), 30, 0)) is not None


def test_better_is_told_in_standard_errors_of_a_paired_difference():
    rng = np.random.default_rng(0)
    a, b = rng.uniform(1, 2, 30), rng.uniform(1, 3, 30)

    def left(residuals: np.ndarray) -> LawFit:
        return LawFit(LawForm((), 1, 0), np.empty(0), residuals, 0.0, 0.0, residuals, residuals)

    difference = np.log(b / a)
    assert left(a).better_than(left(b)) == pytest.approx(difference.mean() / (difference.std() / np.sqrt(29)))
    assert left(a).better_than(left(a)) == 0.0
    assert left(a[:1]).better_than(left(b[:1])) == np.inf * np.sign(difference[0])


def test_rounding_does_not_choose_between_forms_that_explain_the_same():
    rows, form = rows_of(40)  # with the setpoint weighed, the phase of the integral changes K alone
    fits = [fit_law(rows, LawForm(form.terms, 30, 0, 0, phase)) for phase in (0.0, 0.25, 0.5)]
    assert fits[0] is not None and fits[1] is not None and fits[2] is not None
    assert fits[0].gain != pytest.approx(fits[2].gain, rel=1e-3)
    assert fits[0].better_than(fits[1]) == fits[2].better_than(fits[0]) == 0.0
