"""Tables of a study, as plain rows that a terminal and a page can both show."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import pandas as pd
import rich.table
from rich.markup import escape

from eval.consistency import Nees, judge
from eval.outcome import Outcome
from eval.paired import GROUP, Paired, frame, share
from eval.records import Record
from navcore.odometry import BLOCKS

NOTHING = "–"
_LATEX = {c: f"\\{c}" for c in "&%$#_{}"} | {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
}
_LATEX |= {"−": "$-$", "±": r"$\pm$", "∞": r"$\infty$", "°": r"$^\circ$", "²": "$^2$", "…": r"\ldots{}", "–": "--"}


@dataclass(frozen=True)
class Table:
    """A title, column heads, and rows of text; the first `labels` columns name the row."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    labels: int = 1

    def rich(self) -> rich.table.Table:
        """The same for a terminal."""
        table = rich.table.Table(title=escape(self.title), title_justify="left")
        for k, name in enumerate(self.columns):
            table.add_column(escape(name), justify="left" if k < self.labels else "right", no_wrap=k < self.labels)
        for row in self.rows:
            table.add_row(*(escape(text) for text in row))
        return table

    def latex(self) -> str:
        """The same for a paper, with the rules of LaTeX's booktabs; the title is its caption."""
        columns = "".join("l" if k < self.labels else "r" for k in range(len(self.columns)))
        lines = [" & ".join(_latex(text) for text in row) + r" \\" for row in (self.columns, *self.rows)]
        rows = [r"\toprule", lines[0], r"\midrule", *lines[1:], r"\bottomrule"]
        head = [r"\begin{table}", rf"\caption{{{_latex(self.title)}}}", rf"\begin{{tabular}}{{{columns}}}"]
        return "\n".join([*head, *rows, r"\end{tabular}", r"\end{table}", ""])


def score_table(scores: dict[str, float], title: str) -> Table:
    """One run, a row for each measure."""
    rows = tuple((name, f"{value:.6g}") for name, value in scores.items())
    return Table(title, ("measure", "value"), rows)


def overview_table(records: Iterable[Record], pairs: Iterable[Paired], base: str) -> Table:
    """A row for each condition: how well the base does, and what every other arm changes."""
    table, by_group = frame(records), {(*p.group, p.arm): p for p in pairs}
    arms = [arm for arm in table.arm.unique() if arm != base]
    named = len(GROUP) if table.estimator.nunique() > 1 else len(GROUP) - 1  # one estimator needs no name
    rows = []
    for names, group in table.groupby(GROUP, sort=False):
        mine = group[group.arm == base]
        compared = [by_group.get((*(str(n) for n in names), arm)) for arm in arms]
        rows.append(
            (
                *(str(name) for name in names[:named]),
                str(len(mine)),
                _median(mine, "ate_m", ".3f"),
                str((mine.diverged == 1.0).sum() or NOTHING),
                *(change_of(p) if p is not None else NOTHING for p in compared),
            )
        )
    columns = (*GROUP[:named], "runs", f"ATE of {base} [m]", "diverged", *arms)
    return Table(f"Change of ATE against {base}: median (95 % interval)", columns, tuple(rows), labels=named)


def change_of(pair: Paired) -> str:
    """What an arm changes, in words: the median, its interval, and what had to be left out."""
    if pair.median is None:
        found = NOTHING
    elif pair.low is None or pair.high is None:
        found = f"{percent(pair.median)} ({len(pair.seeds)})"
    else:
        found = f"{percent(pair.median)} ({percent(pair.low)} … {percent(pair.high)})"
    apart = f"; {pair.diverged} diverged" if pair.diverged else ""
    return f"{found}{apart}"


def percent(ratio: float) -> str:
    """A ratio as a change in percent."""
    change = round(100.0 * (ratio - 1.0))
    return f"{change:+d} %".replace("-", "−") if change else "±0 %"


def group_table(records: Iterable[Record]) -> Table:
    """A row for each condition and arm: medians over the runs, with the range of ATE."""
    columns = (
        *("condition", "arm", "runs", "failed", "diverged", "complete"),
        *("ATE [m]", "min … max", "ATE [°]", "8 m RPE [m]", "b_g end [rad/s]", "b_a end [m/s²]"),
    )
    rows = []
    for names, group in frame(records).groupby([*GROUP, "arm"], sort=False):
        ate = group["ate_m"].dropna()
        spread = f"{number(ate.min(), '.3f')} … {number(ate.max(), '.3f')}" if len(ate) > 1 else NOTHING
        rows.append(
            (
                *(str(names[2]), str(names[4])),
                *(str(len(group)), str(group.failure.notna().sum()), f"{(group.diverged == 1.0).sum()}"),
                *(_median(group, "completeness", ".1%"), _median(group, "ate_m", ".4f"), spread),
                *(_median(group, "ate_deg", ".3f"), _median(group, "rpe_8m_m", ".4f")),
                *(_median(group, "b_g_end", ".2e"), _median(group, "b_a_end", ".4f")),
            )
        )
    return Table("Scores: medians over the runs of a row, those that diverged among them", columns, tuple(rows), 2)


def paired_table(pairs: Iterable[Paired]) -> Table:
    """A row for each comparison that has more than one seed."""
    columns = (
        *("condition", "arm / base", "pairs", "ATE ratio, median", "95 % interval", "p"),
        *("share of truth's gain", "diverged", "base diverged", "failed"),
    )
    pairs = list(pairs)
    rows = []
    for p in pairs:
        if len(p.seeds) + p.diverged + p.base_diverged + p.failed < 2:
            continue
        interval = f"{p.low:.3f} … {p.high:.3f}" if p.low is not None and p.high is not None else NOTHING
        median = f"{p.median:.3f}" if p.median is not None else NOTHING
        chance = f"{p.p_value:.2g}" if p.p_value is not None else NOTHING
        counts = (str(p.diverged), str(p.base_diverged), str(p.failed))
        label = (p.condition, f"{p.arm} / {p.base}")
        rows.append((*label, str(len(p.seeds)), median, interval, chance, _share(p, pairs), *counts))
    return Table("ATE of each arm over that of the base, seed by seed", columns, tuple(rows), labels=2)


def consistency_table(records: Iterable[Record]) -> Table:
    """A row for each condition and arm whose runs all have NEES: means by block, and the judgement."""
    groups: dict[tuple[str, ...], list[Record]] = {}
    for record in records:
        names = tuple(str(record.config[name]) for name in (*GROUP, "arm"))
        groups.setdefault(names, []).append(record)
    rows = []
    for names, group in groups.items():
        runs = [_nees_of(record) for record in group]
        known = [run for run in runs if run is not None]
        if len(known) < 2 or len(known) < len(runs):
            continue
        result = judge(known)
        means = (f"{mean:.2f}" for mean in result.mean_per_dof)
        wrong = dict.fromkeys(reason.split(":")[0] for reason in result.reasons)
        verdict = "consistent" if result.passed else f"not: {', '.join(wrong)}"
        rows.append((*names, str(len(known)), *means, verdict))
    columns = (*GROUP, "arm", "runs", *BLOCKS, "judgement")
    return Table("NEES by degree of freedom: means over runs and time", columns, tuple(rows), labels=5)


def failure_table(outcome: Outcome) -> Table:
    """A row for each message of cells that raised, for all that have no record, and for what else went wrong."""
    alike: dict[str, list[str]] = {}
    for record in outcome.failures:
        alike.setdefault(record.failure or "", []).append(record.title)
    if outcome.missing:
        alike["was not run"] = list(outcome.missing)
    rows = [(str(len(titles)), titles[0], message) for message, titles in alike.items()]
    rows += [(NOTHING, "outside a cell", error) for error in outcome.errors]
    return Table("What went wrong", ("cells", "the first of them", "message"), tuple(rows), labels=3)


def _nees_of(record: Record) -> Nees | None:
    """The NEES that a record keeps, None if its run has none."""
    names = [f"nees_{block}" for block in BLOCKS]
    if not set(names) <= set(record.series.columns):
        return None
    kept = record.series[["t_s", *names]].dropna()
    values = kept[names].to_numpy(dtype=np.float64)
    return Nees(kept["t_s"].to_numpy(dtype=np.float64), values) if len(kept) else None


def _share(pair: Paired, pairs: list[Paired]) -> str:
    """Its gain as a share of that of the arm `truth` in the same group, where both are certain."""
    if pair.low is None or pair.high is None or pair.low <= 1.0 <= pair.high:
        return NOTHING
    for other in pairs:
        same = other.group == pair.group
        certain = other.arm == "truth" and other.high is not None and other.high < 1.0
        part = share(pair, other) if same and certain and other is not pair else None
        if part is not None:
            return f"{part:.0%}"
    return NOTHING


def _latex(text: str) -> str:
    """Text as LaTeX takes it."""
    return "".join(_LATEX.get(c, c) for c in text)


def _median(group: pd.DataFrame, name: str, form: str) -> str:
    values = group[name].dropna() if name in group else pd.Series(dtype=np.float64)
    return number(float(values.median()), form) if len(values) else NOTHING


def number(value: float, form: str) -> str:
    """A number as text: a dash for one that is not known, ∞ for one without end."""
    return NOTHING if np.isnan(value) else format(value, form) if np.isfinite(value) else "∞"
