import io
import json
import re
import shutil
import subprocess
import sys

import numpy as np
import pytest
from rich.console import Console

from eval import figures
from eval.cells import Study
from eval.errors import StudyError
from eval.outcome import load
from eval.paired import paired
from eval.report import headlines, write_report
from eval.study import run_study
from eval.tables import consistency_table, failure_table, group_table, paired_table
from tests.eval.test_study import cell


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A study of seven seeds; `better` has half the errors, one cell of it raises."""
    folder = tmp_path_factory.mktemp("study")
    cells = [cell(s, "none", draw=s) for s in range(1, 8)]
    cells += [cell(s, "better", draw=50 + s, scale=0.5) for s in range(1, 7)]
    cells.append(cell(7, "better", fail="<b>no luck</b>"))
    run_study(Study("Tiny & fake", tuple(cells)), folder, workers=1)
    return folder


@pytest.fixture(scope="module")
def page(folder):
    return write_report(load(folder), folder).read_text(encoding="utf-8")


def test_the_page_holds_the_numbers_of_the_tables(folder, page):
    outcome = load(folder)
    for table in (group_table(outcome.records), paired_table(paired(outcome.records, "none"))):
        for row in table.rows:
            for text in row:
                assert f">{text}<" in page
    (pair,) = paired(outcome.records, "none")
    assert pair.median is not None and f"better −{100.0 * (1.0 - pair.median):.0f} % (" in page
    assert "14 done, 1 failed" in page


def test_the_page_needs_no_network_and_says_what_is_text_as_text(page):
    outside = page[: page.index("<script>")] + page[page.rindex("<script>") :]
    assert not re.search(r"(src|href)=[\"']?(https?:)?//", outside)
    assert page.count("plotly.js v") == 1  # the library is in it once
    assert "Tiny &amp; fake" in page
    assert "<b>no luck</b>" not in page and "&lt;b&gt;no luck" in page


def test_the_figures_are_json_without_nan_and_show_every_run(folder, page):
    text = re.search(r"const FIGURES = (\{.*\});\n", page).group(1)
    shown = json.loads(text, parse_constant=lambda name: pytest.fail(f"{name} in the page"))
    assert set(shown) == {"ate-0", "ratios", "paths-0", "biases-0", "health-0"}
    marks = [t for t in shown["ate-0"]["data"] if not t["showlegend"]]
    ates = sorted(r.scores["ate_m"] for r in load(folder).records if r.failure is None)
    np.testing.assert_allclose(sorted(y for t in marks for y in t["y"]), ates, rtol=1e-4)
    assert [len(t["x"]) for t in shown["ratios"]["data"] if not t["showlegend"]] == [6]
    names = [t["name"] for t in shown["paths-0"]["data"]]
    assert names == [figures.GROUND_TRUTH, "none", "better"]
    assert {t["xaxis"] for t in shown["biases-0"]["data"]} == {f"x{k}" for k in range(1, 7)}


def test_pictures_lie_beside_the_page(folder, page):
    assert page
    for name in ("ate-fake.png", "ratios.png", "biases.png", "paths.png"):
        assert (folder / name).read_bytes()[:4] == b"\x89PNG"


def test_the_headline_says_how_sure_it_is(folder):
    records = load(folder).records
    (line,) = headlines(paired(records, "none"))
    expected = r"fake, clean, ATE against none: better −\d\d % \(−\d\d % … −\d\d %, 6 seeds\)\."
    assert re.fullmatch(expected, line)
    (line,) = headlines(paired([r for r in records if r.config["seed"] < 4], "none"))
    assert "(3 seeds, too few for an interval)" in line
    assert headlines(paired([r for r in records if r.config["seed"] < 2], "none")) == []


def test_the_table_of_failures_names_cell_and_message(folder):
    (row,) = failure_table(load(folder)).rows
    assert row[1] == "RuntimeError: <b>no luck</b>" and "seed 7" in row[0]


def test_only_groups_that_are_known_whole_are_judged(folder):
    table = consistency_table(load(folder).records)
    assert [row[2] for row in table.rows] == ["none"]  # of `better` one run is missing
    assert float(table.rows[0][4]) == pytest.approx(1.0, abs=0.15)


def test_terminal_tables_show_brackets(folder):
    console = Console(width=250, record=True, file=io.StringIO())
    console.print(group_table(load(folder).records).rich())
    assert "ATE [m]" in console.export_text()


def test_the_report_command_writes_it_again_and_its_exit_says_that_a_cell_failed(folder, tmp_path):
    copy = tmp_path / "copy"
    shutil.copytree(folder, copy)
    (copy / "report.html").unlink(missing_ok=True)
    command = [sys.executable, "-m", "eval", "report", str(copy)]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 1 and "no luck" in result.stdout
    assert (copy / "report.html").is_file()
    (copy / "study.json").unlink()
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 1 and "error:" in result.stderr and "study.json" in result.stderr


def test_a_folder_without_a_study_is_named(tmp_path):
    with pytest.raises(StudyError, match=r"study\.json: no such file"):
        load(tmp_path)
    (tmp_path / "study.json").write_text("[1]")
    with pytest.raises(StudyError, match="not the list of a study"):
        load(tmp_path)
