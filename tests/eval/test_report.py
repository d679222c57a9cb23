import io
import json
import re
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from rich.console import Console

from eval import figures, pictures
from eval.__main__ import main
from eval.cells import Study
from eval.errors import StudyError
from eval.outcome import load
from eval.paired import paired
from eval.report import headlines, of_recording, write_report
from eval.study import run_study
from eval.tables import Table, consistency_table, failure_table, group_table, paired_table
from tests.eval.test_study import cell

CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")


@pytest.fixture(scope="module")
def folder(scheduler, tmp_path_factory):
    """A study of seven seeds; `better` has half the errors, one cell of it raises."""
    folder = tmp_path_factory.mktemp("study")
    cells = [cell(s, "none", draw=s) for s in range(1, 8)]
    cells += [cell(s, "better", draw=50 + s, scale=0.5) for s in range(1, 7)]
    cells.append(cell(7, "better", fail="<b>no luck</b>"))
    run_study(Study("Tiny & fake", tuple(cells)), folder, scheduler=scheduler)
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
    assert pair.median is not None and f">−{100.0 * (1.0 - pair.median):.0f} % (" in page
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
    assert set(shown) == {"ate-fake-tests", "ratios-fake-tests", "paths-0", "biases-0", "health-0"}
    places = set(re.findall(r'data-figure="([^"]+)"', page))
    assert places == {"ate-fake-tests", "ratios-fake-tests"}
    marks = [t for t in shown["ate-fake-tests"]["data"] if not t["showlegend"]]
    assert {text for t in marks for text in t["text"]} == {f"fake {seed}" for seed in range(1, 8)}
    ates = sorted(r.scores["ate_m"] for r in load(folder).records if r.failure is None)
    np.testing.assert_allclose(sorted(y for t in marks for y in t["y"]), ates, rtol=1e-4)
    assert [len(t["x"]) for t in shown["ratios-fake-tests"]["data"] if not t["showlegend"]] == [6]
    names = [t["name"] for t in shown["paths-0"]["data"]]
    assert names == [figures.GROUND_TRUTH, "none", "better"]
    assert {t["xaxis"] for t in shown["biases-0"]["data"]} == {f"x{k}" for k in range(1, 7)}


def test_pictures_and_tables_for_papers_lie_beside_the_page(folder, page):
    assert page
    for name in ("ate-fake-tests", "ratios-fake-tests", "biases", "paths"):
        assert (folder / "figures" / f"{name}.png").read_bytes()[:4] == b"\x89PNG"
        assert (folder / "figures" / f"{name}.pdf").read_bytes()[:4] == b"%PDF"
    names = {"overview", "consistency", "scores-fake-tests", "paired-fake-tests"}
    assert {path.stem for path in (folder / "tables").iterdir()} == names
    (row,) = paired_table(paired(load(folder).records, "none")).rows
    assert rf"{row[0]} & {row[1]} & {row[2]}" in (folder / "tables" / "paired-fake-tests.tex").read_text()


def test_text_is_text_in_latex_too():
    table = Table("a_b & 5 %", ("x^2", "−1 {m/s²}"), (("\\", "1 … 2"),))
    assert table.latex().splitlines() == [
        r"\begin{table}",
        r"\caption{a\_b \& 5 \%}",
        r"\begin{tabular}{lr}",
        r"\toprule",
        r"x\textasciicircum{}2 & $-$1 \{m/s$^2$\} \\",
        r"\midrule",
        r"\textbackslash{} & 1 \ldots{} 2 \\",
        r"\bottomrule",
        r"\end{tabular}",
        r"\end{table}",
    ]


def test_every_run_is_listed_with_its_key_and_has_a_report_of_its_own(folder, page, monkeypatch, capsys):
    records = load(folder).records
    assert all(f"<code>{r.key}</code>" in page for r in records)
    failed = next(r for r in records if r.failure)
    row = page[: page.index(failed.key)].rpartition("<tr>")[2]
    assert "no luck" in row and "fake 7" in row and "better" in row
    key = next(r.key for r in records if r.config["seed"] == 3)
    monkeypatch.setattr("sys.argv", ["python -m eval", "report", str(folder), "--run", key])
    assert main() == 0
    capsys.readouterr()
    alone = (folder / "runs" / key / "report.html").read_text(encoding="utf-8")
    assert "All 2 runs" in alone and "fake 3" in alone and "fake 4" not in alone
    for wrong, found in (("", 14), ("nonsense", 0)):
        with pytest.raises(StudyError, match=f"{found} runs that are done have a key that begins with '{wrong}'"):
            of_recording(load(folder), wrong)


@pytest.mark.skipif(CHROMIUM is None, reason="Chromium is not installed")
def test_a_browser_draws_it_without_errors_and_without_network(folder, page, tmp_path):
    """Every figure, every link's place, nothing on the console, nothing fetched from anywhere."""
    assert page
    dom, said, asked = opened(folder / "report.html", tmp_path)
    wrong = re.compile(r"CONSOLE.*(Uncaught|Error|Failed|Refused|violat|not found)")  # hints on speed are no errors
    assert not wrong.search(said), said
    assert asked == set()
    places = re.findall(r"<div class=\"([^\"]*)\"[^>]* data-(?:figure|example)=", dom)
    assert len(places) == 5 and all("js-plotly-plot" in classes for classes in places)
    dom = re.sub(r"<script>.*?</script>", "", dom, flags=re.DOTALL)
    ids = set(re.findall(r' id="([^"]+)"', dom))
    links = re.findall(r'<a href="([^"]+)"', dom)
    assert links and all(link.startswith("#") and link[1:] in ids for link in links)


def opened(page, folder):
    """What a browser makes of a page: its document, what it says, and the origins of what it asks of the network."""
    log = folder / "net.json"
    flags = ["--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking"]
    flags += ["--disable-component-update", "--disable-sync", "--disable-quic", f"--user-data-dir={folder / 'profile'}"]
    flags += [
        "--window-size=1200,12000",
        "--virtual-time-budget=20000",
        "--enable-logging=stderr",
        f"--log-net-log={log}",
    ]
    done = subprocess.run(
        [CHROMIUM, *flags, "--dump-dom", page.as_uri()], capture_output=True, text=True, check=True, timeout=100
    )
    asked = set(re.findall(r'"initiator":"([^"]+)"', log.read_text()))
    return done.stdout, done.stderr, asked - {"not an origin"}  # which is the browser's own


def test_the_headline_says_how_sure_it_is(folder):
    records = load(folder).records
    (line,) = headlines(paired(records, "none"))
    expected = (
        r"better: ATE −\d\d % against none in the middle of 1 conditions; the whole interval is better"
        r" in 1, worse in 0; 0 runs diverged against 0\."
    )
    assert re.fullmatch(expected, line)
    again = [replace(r, config=r.config | {"regime": "shared"}) for r in records]
    assert headlines(paired([*records, *again], "none")) == [line]
    assert headlines(paired([r for r in records if r.config["seed"] < 4], "none")) == []


def test_the_table_of_failures_names_cell_and_message(folder):
    outcome = load(folder)
    (row,) = failure_table(outcome).rows
    assert row[0] == "1" and "fake 7" in row[1] and row[2] == "RuntimeError: <b>no luck</b>"
    broken = replace(outcome, missing=("one", "two"), errors=("a worker died",))
    rows = failure_table(broken).rows
    assert rows[1:] == (("2", "one", "was not run"), ("–", "outside a cell", "a worker died"))


def test_only_groups_that_are_known_whole_are_judged(folder):
    table = consistency_table(load(folder).records)
    assert [row[4] for row in table.rows] == ["none"]  # of `better` one run is missing
    assert float(table.rows[0][6]) == pytest.approx(1.0, abs=0.15)


def test_terminal_tables_show_brackets(folder):
    console = Console(width=250, record=True, file=io.StringIO())
    console.print(group_table(load(folder).records).rich())
    assert "ATE [m]" in console.export_text()


def test_the_report_command_writes_it_again_and_its_exit_says_that_a_cell_failed(folder, tmp_path, monkeypatch, capsys):
    copy = tmp_path / "copy"
    shutil.copytree(folder, copy)
    (copy / "report.html").unlink(missing_ok=True)
    monkeypatch.setattr("sys.argv", ["python -m eval", "report", str(copy)])
    assert main() == 1 and "no luck" in capsys.readouterr().out
    assert (copy / "report.html").is_file()
    (copy / "study.json").unlink()
    with pytest.raises(SystemExit, match="1"):
        main()
    said = capsys.readouterr().err
    assert "error:" in said and "study.json" in said


def test_a_folder_without_a_study_is_named(tmp_path):
    with pytest.raises(StudyError, match=r"study\.json: no such file"):
        load(tmp_path)
    (tmp_path / "study.json").write_text("[1]")
    with pytest.raises(StudyError, match="not the list of a study"):
        load(tmp_path)


def leveled(seed, arm, condition, level, draw):
    return replace(cell(seed, arm, draw=draw), regime="outage", condition=condition, level=level, axis="length [s]")


def test_conditions_stand_on_their_axis_in_order_and_arms_have_room(scheduler, tmp_path):
    """Cells of the longer outage come first; in the figure their place decides."""
    cells = [leveled(1, arm, f"{level:g} s", level, 7 * k) for level in (20.0, 5.0) for k, arm in enumerate("ab")]
    run_study(Study("leveled", tuple(cells), "a"), tmp_path, scheduler=scheduler)
    records = load(tmp_path).records
    figure = figures.ate_by_condition(list(records), ["a", "b"])
    axis = figure["layout"]["xaxis"]
    assert axis["tickvals"] == [5.0, 20.0] and axis["ticktext"] == ["5", "20"]
    assert axis["title"]["text"] == "length [s]"
    for trace in figure["data"]:
        assert trace["mode"] == "lines+markers" and trace["x"] == sorted(trace["x"])
        assert all(abs(x - at) < 2.0 for x, at in zip(trace["x"], (5.0, 20.0), strict=True))
    texts = figure["layout"]["yaxis"]["ticktext"]
    assert "0.02" in texts and "1" in texts
    none = [replace(r, config=r.config | {"axis": "", "level": None}) for r in records]
    bare = figures.ate_by_condition(none, ["a", "b"])
    assert bare["layout"]["xaxis"]["ticktext"] == ["20 s", "5 s"] and "title" not in bare["layout"]["xaxis"]
    assert all(trace["mode"] == "markers" for trace in bare["data"])


def told(record, arm, prior):
    """A record of another arm whose source said two things."""
    said = {"t_ns": [0, 1], "t_s": [2.0, 4.0]}
    for name, sigma in (("b_g", 0.01), ("b_a", 0.1)):
        for k, axis in enumerate("xyz"):
            said |= {f"{name}_{axis}": [k + 0.25, k + 0.5], f"sigma_d{name}_{axis}": [sigma, 2.0 * sigma]}
    return replace(record, config=record.config | {"arm": arm, "prior": prior}, statements=pd.DataFrame(said))


def test_biases_show_what_sources_said_beside_the_filter_and_the_truth(folder, tmp_path):
    """Six panels: the base and the sources of measurements at first, the others when the legend is asked."""
    (base,) = (r for r in load(folder).records if r.config["arm"] == "none" and r.config["seed"] == 1)
    arms = ["none", "constant", "ipnet", "truth"]
    records = [base, *(told(base, arm, "truth" if arm == "truth" else f"{arm}:x") for arm in arms[1:])]
    records[1] = replace(records[1], statements=pd.DataFrame())
    figure = figures.biases(records, arms)
    said = [t for t in figure["data"] if t["mode"] == "markers"]
    assert [(t["name"], t["xaxis"], t["x"]) for t in said] == [
        ("ipnet", f"x{n}", [2.0, 4.0]) for n in (1, 3, 5, 2, 4, 6)
    ]
    assert [t["y"] for t in said] == [[k + 0.25, k + 0.5] for k in (0, 1, 2)] * 2
    assert [t["error_y"]["array"] for t in said] == [[0.01, 0.02]] * 3 + [[0.1, 0.2]] * 3
    hidden = {t["name"] for t in figure["data"] if t.get("visible") == "legendonly"}
    assert hidden == {"constant", "truth"}
    shown = {t["name"] for t in figure["data"] if "visible" not in t}
    assert shown == {"none", "ipnet", figures.GROUND_TRUTH}
    widths = {t["name"]: t["line"]["width"] for t in figure["data"] if t["mode"] == "lines" and t["showlegend"]}
    assert widths["none"] > 2.0 * widths["ipnet"]  # seen below what covers it
    band = next(t for t in figure["data"] if t.get("fill") and t["name"] == "none")
    known = base.series["b_g_x"].notna()
    sigma = (base.series["b_g_x"] + base.series["sigma_db_g_x"])[known]
    np.testing.assert_allclose(band["y"][: known.sum()], sigma, rtol=1e-4)
    low, high = figure["layout"]["yaxis5"]["range"]
    assert low < base.series["true_b_g_z"].min() and high > 2.4  # most of what was said about b_g z
    assert not any("visible" in t for t in figures.biases(records[:2], arms)["data"])  # no sources: all are shown
    pictures.save_biases(records, arms, tmp_path / "biases")
    assert (tmp_path / "biases.png").read_bytes()[:4] == b"\x89PNG"
