"""Paths of any systems against one truth, over the time that all of them have."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from eval.alignment import Mode
from eval.errors import ScoreError
from eval.files import read_estimate
from eval.metrics import associate, position_errors, score
from eval.tables import NOTHING, Table, number
from navcore.trajectory import Trajectory

_MEASURES = {
    "poses": ("poses", ".0f"),
    "path_m": ("path [m]", ".1f"),
    "ate_m": ("ATE [m]", ".4f"),
    "ate_deg": ("ATE [°]", ".3f"),
    "initial_ate_m": ("ATE of the first 10 s [m]", ".4f"),
    "rpe_m": ("RPE [m a pose]", ".5f"),
    "rpe_rad": ("RPE [rad a pose]", ".6f"),
    **{f"rpe_{n}m_m": (f"RPE {n} m [m]", ".4f") for n in (8, 16, 24, 32, 40)},
    "diverged": ("diverged", ".0f"),
}


@dataclass(frozen=True)
class Comparison:
    """Systems by name, all cut to the same span of time.

    Attributes:
        paths: those of the systems.
        truth: the path that they are compared with.
        alignment: what is fitted before errors are taken.
        begin_s, end_s: the span, from the truth's first pose.
    """

    paths: Mapping[str, Trajectory]
    truth: Trajectory
    alignment: Mode
    begin_s: float
    end_s: float

    @staticmethod
    def of(paths: Mapping[str, Trajectory], truth: Trajectory, alignment: Mode = "yaw") -> "Comparison":
        """A comparison over the time that all paths, and the truth, have.

        Raises:
            ScoreError: no path, an empty one, or no time that all of them have.
        """
        if not paths:
            raise ScoreError("nothing to compare; expected one trajectory or more")
        empty = [name for name, path in {**paths, "the truth": truth}.items() if len(path) == 0]
        if empty:
            raise ScoreError(f"no pose in {', '.join(empty)}")
        begin = max(int(path.t_ns[0]) for path in (*paths.values(), truth))
        end = min(int(path.t_ns[-1]) for path in (*paths.values(), truth))
        if end <= begin:
            spans = (f"{name} {path.t_ns[0]} … {path.t_ns[-1]} ns" for name, path in {**paths, "truth": truth}.items())
            raise ScoreError(f"there is no time that all of them have: {', '.join(spans)}")
        cut = {name: path[(path.t_ns >= begin) & (path.t_ns <= end)] for name, path in paths.items()}
        first = int(truth.t_ns[0])
        return Comparison(cut, truth, alignment, (begin - first) * 1e-9, (end - first) * 1e-9)

    def scores(self) -> dict[str, dict[str, float]]:
        """What `eval.metrics.score` says of each system."""
        return {name: score(path, self.truth, alignment=self.alignment) for name, path in self.paths.items()}

    def table(self) -> Table:
        """A column for each system."""
        scores = self.scores()
        rows = []
        for name, (label, form) in _MEASURES.items():
            values = [number(s[name], form) if name in s else NOTHING for s in scores.values()]
            if any(value != NOTHING for value in values):
                rows.append((label, *values))
        span = f"{self.begin_s:.2f} … {self.end_s:.2f} s of the truth, {self.alignment} alignment"
        return Table(span, ("measure", *scores), tuple(rows))

    def save_plot(self, file: Path) -> None:
        """Draw the paths from above, aligned, and their distances from the truth over time.

        Raises:
            ScoreError: the file cannot be written.
        """
        figure = Figure(figsize=(9.0, 4.0), layout="constrained")
        above, error = figure.subplots(1, 2)
        origin = int(self.truth.t_ns[0])
        ends = origin + np.round(np.array([self.begin_s, self.end_s]) * 1e9)
        shown = self.truth[(self.truth.t_ns >= ends[0]) & (self.truth.t_ns <= ends[1])]
        above.plot(*shown.p_WB[:, :2].T, color="0.6", label="truth")
        for name, path in self.paths.items():
            pair = associate(path, self.truth).aligned(self.alignment)
            above.plot(*pair.estimate.p_WB[:, :2].T, lw=1.0, label=name)
            error.plot((pair.estimate.t_ns - origin) * 1e-9, position_errors(pair), lw=1.0, label=name)
        above.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
        error.set(xlabel="t [s]", ylabel="distance from the truth [m]", ylim=(0.0, None))
        above.legend(frameon=False, fontsize="small")
        for axes in (above, error):
            axes.grid(alpha=0.3)
        FigureCanvasAgg(figure)
        try:
            figure.savefig(file, dpi=160)
        except (OSError, ValueError) as problem:
            raise ScoreError(f"{file} cannot be written: {problem}") from problem


def named(files: tuple[Path, ...]) -> dict[str, Trajectory]:
    """Trajectories by short names: of the file or folder, and as much of the path before it as tells them apart."""
    for depth in range(1, max((len(f.parts) for f in files), default=0) + 1):
        names = ["/".join(f.with_suffix("").parts[-depth:]) for f in files]
        if len(set(names)) == len(files):
            return {name: read_estimate(file) for name, file in zip(names, files, strict=True)}
    raise ScoreError(f"a trajectory is named twice: {', '.join(map(str, files))}")
