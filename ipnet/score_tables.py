"""Scores as tables, for a terminal and for a page."""

from dataclasses import dataclass

import rich.table
from rich.markup import escape

from ipnet.figures import Figures
from ipnet.scoring import ArmScore, Scores


@dataclass(frozen=True)
class Table:
    """A title, column heads, and rows of text; the first column names the row."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    def rich(self) -> rich.table.Table:
        """For a terminal."""
        table = rich.table.Table(title=escape(self.title), title_justify="left")
        for k, name in enumerate(self.columns):
            table.add_column(escape(name), justify="right" if k else "left")
        for row in self.rows:
            table.add_row(*(escape(text) for text in row))
        return table

    def markdown(self) -> str:
        """For a page."""
        lines = (self.columns, tuple("---" for _ in self.columns), *self.rows)
        return f"{self.title}\n\n" + "\n".join("| " + " | ".join(line) + " |" for line in lines) + "\n"


def tables(scores: Scores) -> list[Table]:
    """Error, response, coverage and likelihood: over a run, then of single measurements."""
    names, arms = scores.axes.names, scores.arms
    where = f"{scores.runs} runs of {scores.seconds:.0f} s from {len(scores.recordings)} recordings"
    columns = ("arm", *names)
    known = [("constant" if scores.config.device else "nothing known", scores.constant)]
    known += [(a.arm + _warning(a), a.over_run) for a in arms]
    error = tuple(_row(name, [f"{x:.2g}" for x in f.rmse]) for name, f in known)
    spread = tuple(_row(name, _intervals(f)) for name, f in known)
    over_run = [
        Table(f"RMSE over a run [rad/s, m/s²]; {where}", columns, error),
        Table("Its 95 % interval over recordings", columns, spread),
    ]
    if any(a.response for a in arms):
        response = tuple(_row(a.arm, [f"{x:.2f}" for x in a.response]) for a in arms)
        over_run.append(Table("Offset response over a run (1 infers, 0 remembers)", columns, response))
    stated = tuple(_row(a.arm, [f"{c:.0%}" for c in a.over_run.coverage]) for a in arms)
    over_run.append(Table("Coverage of the 90 % intervals over a run", columns, stated))
    gain = tuple(_row(a.arm, [f"{x:+.2f}" for x in a.gain]) for a in arms)
    against = "the constant prior's" if scores.config.device else "that of knowing nothing"
    over_run.append(Table(f"Log likelihood over a run above {against} [nats]", columns, gain))
    return over_run + _windows(arms, columns)


def _windows(arms: tuple[ArmScore, ...], columns: tuple[str, ...]) -> list[Table]:
    spoken = [(a.arm, a.windows) for a in arms if a.windows is not None and not a.joined]
    if not spoken:
        return []
    error = tuple(_row(f"{arm} ({w.count})", [f"{x:.2g}" for x in w.rmse]) for arm, w in spoken)
    stated = tuple(_row(arm, [f"{c:.0%}" for c in w.coverage]) for arm, w in spoken)
    return [
        Table("RMSE of single measurements (how many) [rad/s, m/s²]", columns, error),
        Table("Coverage of their 90 % intervals", columns, stated),
    ]


def _warning(arm: ArmScore) -> str:
    """What a reader must know of an arm before its error."""
    silent = f" (says nothing in {arm.silent} runs)" if arm.silent else ""
    return silent + (f" (made from {len(arm.seen)} of these recordings)" if arm.seen else "")


def _row(name: str, cells: list[str]) -> tuple[str, ...]:
    return (name, *cells)


def _intervals(figures: Figures) -> list[str]:
    return [f"{low:.1g}…{high:.1g}" for low, high in zip(figures.low, figures.high, strict=True)]
