"""Error models of sources."""

import numpy as np
import pytest

from ipnet.calibration import ErrorModel, WindowErrors, fit
from ipnet.errors import ConfigError

SIGMA_C = np.array([0.01, 0.02, 0.005, 0.1, 0.05, 0.2])
SCALE = np.array([1.0, 2.0, 0.5, 1.5, 3.0, 1.0])


def drawn(rng, recordings, windows=12, overlap=1, floor=0.0, correlation=0.0):
    """Errors with known scales: white at one window of 5 s, averaged so that `overlap` windows share each part."""
    constant = np.diag(SIGMA_C**2)
    constant[0, 1] = constant[1, 0] = correlation * SIGMA_C[0] * SIGMA_C[1]
    found = []
    for k in range(recordings):
        c = rng.multivariate_normal(np.zeros(6), constant)
        stated = np.exp(rng.uniform(-1.0, 1.0, (windows, 6))) * 0.02**2
        e = rng.normal(size=(windows, 6)) * np.sqrt(SCALE**2 * stated + floor**2)
        t_ns = np.arange(windows * overlap) * round(5e9 / overlap)
        found.append(WindowErrors(f"r{k}", t_ns, c + np.repeat(e, overlap, axis=0), np.repeat(stated, overlap, axis=0)))
    return found


def test_known_values_come_back():
    model = fit(drawn(np.random.default_rng(1), 400, correlation=0.8), 5.0)
    np.testing.assert_allclose(np.sqrt(np.diagonal(model.constant)), SIGMA_C, rtol=0.12)
    correlation = model.constant[0, 1] / np.sqrt(model.constant[0, 0] * model.constant[1, 1])
    np.testing.assert_allclose(correlation, 0.8, atol=0.1)
    np.testing.assert_allclose(np.sqrt(model.variance(np.full(6, 4e-4))), SCALE * 0.02, rtol=0.06)
    assert np.all(model.floor < 0.01)


def test_a_floor_comes_back():
    model = fit(drawn(np.random.default_rng(2), 400, floor=0.03), 5.0)
    np.testing.assert_allclose(model.floor, 0.03, rtol=0.15)
    np.testing.assert_allclose(model.scale[[1, 3, 4]], SCALE[[1, 3, 4]], rtol=0.15)


def test_without_floors_all_is_scaled():
    model = fit(drawn(np.random.default_rng(2), 100, floor=0.03), 5.0, floors=False)
    assert np.all(model.floor == 0.0)
    assert np.all(model.scale > 1.05 * SCALE)


def test_windows_that_overlap_count_once():
    """Fourfold copies are no new information: c must not get smaller, nor e."""
    model = fit(drawn(np.random.default_rng(3), 200, windows=6, overlap=4), 5.0)
    np.testing.assert_allclose(np.sqrt(np.diagonal(model.constant)), SIGMA_C, rtol=0.2)
    np.testing.assert_allclose(np.sqrt(model.variance(np.full(6, 4e-4))), SCALE * 0.02, rtol=0.1)


def test_what_is_told_again_is_no_recording_more():
    """Each recording cut in three ways: as certain as cut in one."""
    errors = drawn(np.random.default_rng(7), 5)
    once, thrice = fit(errors, 5.0), fit([e for e in errors for _ in range(3)], 5.0)
    np.testing.assert_allclose(thrice.constant, once.constant, rtol=1e-6)
    np.testing.assert_allclose(thrice.variance(np.full(6, 4e-4)), once.variance(np.full(6, 4e-4)), rtol=1e-6)


def test_a_constant_error_that_was_not_seen_is_not_excluded():
    """Ten recordings of errors without a constant part, of sd 0.1 in the mean of four windows."""
    t_ns = np.arange(4) * 5_000_000_000
    rng = np.random.default_rng(8)
    errors = [WindowErrors(f"r{k}", t_ns, rng.normal(0.0, 0.2, (4, 6)), np.full((4, 6), 0.04)) for k in range(10)]
    sd = np.sqrt(np.diagonal(fit(errors, 0.0).constant))
    assert np.all((sd > 0.05) & (sd < 0.12))


def test_stated_variances_that_never_differ_are_scaled():
    errors = [WindowErrors(e.recording, e.t_ns, e.error, np.ones((12, 6))) for e in drawn(np.random.default_rng(4), 50)]
    model = fit(errors, 5.0)
    assert np.all(model.floor == 0.0)
    assert np.all(model.scale < 0.2)


def test_few_recordings_give_caution():
    """Three recordings: predictions for a fourth must not be overconfident, nor singular."""
    nees = []
    for seed in range(30):
        model = fit(drawn(np.random.default_rng(seed), 3), 5.0)
        c = np.random.default_rng(1000 + seed).normal(size=6) * SIGMA_C
        nees.append(c @ np.linalg.solve(model.constant, c) / 6.0)
    assert np.median(nees) < 1.5


def test_it_survives_a_file_and_refuses_what_it_cannot_use():
    model = fit(drawn(np.random.default_rng(5), 20), 5.0)
    again = ErrorModel.from_dict(model.as_dict())
    np.testing.assert_array_equal(again.constant, model.constant)
    with pytest.raises(ConfigError, match="expected \\['constant', 'floor', 'scale'\\]"):
        ErrorModel.from_dict({"constant": np.eye(6).tolist()})
    with pytest.raises(ConfigError, match="two or more"):
        fit(drawn(np.random.default_rng(6), 1), 5.0)
