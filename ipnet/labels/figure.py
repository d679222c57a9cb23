"""Labels against true means: a panel per axis, with the straight line through them and how sure it is."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy import stats

from ipnet.errors import LabelError
from ipnet.recordings import Label
from navcore.arrays import Floats

FEWEST = 3
"""Recordings below which no line has a spread."""
_CONFIDENCE = 0.95
_AXES = [f"{b}{x}" for b in ("$b_g$ ", "$b_a$ ") for x in "xyz"]


@dataclass(frozen=True)
class Line:
    """y = intercept + slope x by least squares.

    Attributes:
        slope, intercept: of the line.
        mean_x, spread_x: mean of x, and the sum of squares about it.
        n: points.
        scatter: standard deviation of a point about the line.
    """

    slope: float
    intercept: float
    mean_x: float
    spread_x: float
    n: int
    scatter: float

    def bands(self, x: Floats) -> tuple[Floats, Floats]:
        """Half widths at x (N,) of the 95 % bands: where the line is, and where another point would be.

        Draper, Smith, "Applied Regression Analysis" (1998), section 3.1.
        """
        t = float(stats.t.ppf(0.5 + 0.5 * _CONFIDENCE, self.n - 2))
        of_line = 1.0 / self.n + (x - self.mean_x) ** 2 / self.spread_x
        return t * self.scatter * np.sqrt(of_line), t * self.scatter * np.sqrt(1.0 + of_line)


def line(x: Floats, y: Floats) -> Line:
    """The line through N points.

    Raises:
        LabelError: there are fewer than `FEWEST` points, or they have one x.
    """
    n = len(x)
    spread = float(np.sum((x - x.mean()) ** 2)) if n else 0.0
    if n < FEWEST or spread == 0.0:
        raise LabelError(f"{n} labels with true biases beside them; a figure needs {FEWEST} that differ")
    slope = float(np.sum((x - x.mean()) * (y - y.mean()))) / spread
    intercept = float(y.mean() - slope * x.mean())
    scatter = float(np.sqrt(np.sum((y - intercept - slope * x) ** 2) / (n - 2)))
    return Line(slope, intercept, float(x.mean()), spread, n, scatter)


def draw(path: Path, labels: Iterable[tuple[Label, Floats]]) -> None:
    """Draw labels against (6,) true means; the PNG appears whole or not.

    As the figure "IMU Bias Calculation Accuracy Experiment" of Yi et al., "A Plug-and-Play Learning-based IMU Bias
    Factor for Robust Visual-Inertial Odometry", with the labels' own standard deviations as bars.

    Raises:
        LabelError: there are too few of them, or the file cannot be written.
    """
    pairs = list(labels)
    true = np.array([t for _, t in pairs]).reshape(-1, 6)
    found = np.array([x.bias for x, _ in pairs]).reshape(-1, 6)
    sigma = np.sqrt([np.diag(x.covariance) for x, _ in pairs]).reshape(-1, 6)
    figure = Figure(figsize=(12.0, 12.0), layout="constrained")
    panels = figure.subplots(4, 3, height_ratios=(2.0, 1.0, 2.0, 1.0))
    for k in range(6):
        row, column = 2 * (k // 3), k % 3
        scale, unit = (1e3, "mrad/s") if k < 3 else (1.0, "m/s$^2$")
        _panel(panels[row, column], panels[row + 1, column], scale * true[:, k], scale * found[:, k])
        for panel, y in ((panels[row, column], found[:, k]), (panels[row + 1, column], (found - true)[:, k])):
            panel.errorbar(
                scale * true[:, k],
                scale * y,
                yerr=scale * sigma[:, k],
                fmt="o",
                markersize=3,
                color="C3",
                elinewidth=0.8,
                label="label ± 1 sd",
            )
        fit = line(scale * true[:, k], scale * found[:, k])
        title = f"{_AXES[k]} [{unit}]: slope {fit.slope:.4f}\nintercept {fit.intercept:+.2g}, scatter {fit.scatter:.2g}"
        panels[row, column].set_title(title, fontsize=10)
        panels[row + 1, column].set_xlabel(f"mean of the true bias [{unit}]")
    for row, name in enumerate(("label", "label less true mean") * 2):
        panels[row, 0].set_ylabel(name)
    panels[0, 0].legend(fontsize=8, loc="upper left")
    figure.suptitle(f"Labels of {len(pairs)} recordings against their true biases")
    partial = path.with_name(path.name + ".partial")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(partial, dpi=110, format="png")
        partial.replace(path)
    except OSError as error:
        raise LabelError(f"{path}: cannot be written: {error}") from error


def _panel(above: Axes, below: Axes, x: Floats, y: Floats) -> None:
    """The line through labels y at true means x, with its bands, and the same less the true means."""
    fit = line(x, y)
    margin = 0.08 * float(np.ptp(x))
    at = np.linspace(x.min() - margin, x.max() + margin, 100)
    of_line, of_point = fit.bands(at)
    for panel, equal in ((above, at), (below, np.zeros_like(at))):
        middle = fit.intercept + fit.slope * at - (at - equal)
        panel.fill_between(at, middle - of_point, middle + of_point, color="gold", alpha=0.35, label="95 % prediction")
        panel.fill_between(at, middle - of_line, middle + of_line, color="grey", alpha=0.5, label="95 % confidence")
        panel.plot(at, equal, color="black", linewidth=0.8, linestyle=":", label="equal")
        panel.plot(at, middle, color="C0", linewidth=1.0, label="fit")
