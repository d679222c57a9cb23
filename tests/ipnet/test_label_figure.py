"""The line through labels, against SciPy's, and the picture of it."""

import numpy as np
import pytest
from scipy import stats

from ipnet.errors import LabelError
from ipnet.labels.figure import draw, line
from ipnet.recordings import Label


def test_line_and_bands_are_those_of_regression():
    rng = np.random.default_rng(1)
    x = rng.standard_normal(12)
    y = 0.3 + 0.9 * x + 0.1 * rng.standard_normal(12)
    fit, other = line(x, y), stats.linregress(x, y)
    assert (fit.slope, fit.intercept) == (pytest.approx(other.slope), pytest.approx(other.intercept))
    of_line, of_point = fit.bands(np.array([0.0]))
    t = stats.t.ppf(0.975, 10)
    assert of_line[0] == pytest.approx(t * other.intercept_stderr)
    assert of_point[0] == pytest.approx(t * np.hypot(other.intercept_stderr, fit.scatter))


def test_prediction_bands_hold_what_they_say():
    rng, inside = np.random.default_rng(2), 0
    for _ in range(2000):
        x = rng.standard_normal(8)
        fit = line(x, 2.0 * x + rng.standard_normal(8))
        inside += abs(2.0 + rng.standard_normal() - fit.intercept - fit.slope) < fit.bands(np.array([1.0]))[1][0]
    assert inside / 2000 == pytest.approx(0.95, abs=0.015)


def test_a_figure_is_drawn(tmp_path):
    rng = np.random.default_rng(3)
    true = rng.standard_normal((4, 6))
    draw(tmp_path / "new" / "labels.png", [(Label(str(k), b + 0.01, 1e-4 * np.eye(6)), b) for k, b in enumerate(true)])
    assert (tmp_path / "new" / "labels.png").read_bytes().startswith(b"\x89PNG")
    assert [x.name for x in (tmp_path / "new").iterdir()] == ["labels.png"]


def test_too_few_labels_make_no_figure(tmp_path):
    with pytest.raises(LabelError, match=r"2 labels .* a figure needs 3"):
        draw(tmp_path / "labels.png", [(Label(str(k), np.ones(6), np.eye(6)), np.ones(6) * k) for k in range(2)])
    assert not list(tmp_path.iterdir())
