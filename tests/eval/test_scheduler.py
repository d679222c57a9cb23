"""Studies on a Dask scheduler that was there before: workers come and go."""

import signal
from collections import Counter
from threading import Thread

import pytest
from distributed import LocalCluster

from eval import records, workplace
from eval import study as module
from eval.cells import Study
from eval.errors import StudyError
from eval.study import run_study
from tests.eval.processes import Processes, wait_until
from tests.eval.test_study import cell

ARMS = ("none", "constant", "truth")


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    """A scheduler and two workers, each a process."""
    running = Processes(tmp_path_factory.mktemp("cluster"))
    try:
        running.add_worker()
        running.add_worker()
        wait_until(lambda: running.workers() == 2)
        yield running
    finally:
        running.close()


def slow_study(folder, recordings, killer=None):
    """Three arms of some recordings; the cell `killer` (recording, arm) ends its worker the first time."""
    cells = []
    for seed in range(1, recordings + 1):
        for k, arm in enumerate(ARMS):
            options = {"diary": str(folder / "diary"), "draw": 10 * seed + k, "sleep_s": 0.2}
            if (seed, arm) == killer:
                options["kill_once"] = str(folder / "killed")
            cells.append(cell(seed, arm, **options))
    return Study("slow", tuple(cells))


def runs_of(folder):
    """How often each cell began, and by which processes."""
    lines = [line.split() for line in (folder / "diary").read_text().splitlines()]
    return Counter(int(draw) for draw, _ in lines), {int(pid) for _, pid in lines}


def test_nothing_is_lost_or_counted_twice_when_a_worker_is_killed(cluster, tmp_path):
    study, seen = slow_study(tmp_path, 6, killer=(2, "constant")), []
    outcome = run_study(study, tmp_path, scheduler=cluster.address, progress=seen.append)
    assert (tmp_path / "killed").exists()
    wait_until(lambda: cluster.workers() == 1)
    assert not outcome.errors and not outcome.missing and not outcome.failures
    keys = [c.key(outcome.index.versions) for c in study.cells]
    assert [r.key for r in outcome.records] == keys and len(set(keys)) == 18
    assert {p.name for p in (tmp_path / "cells").iterdir()} == {f"{key}.parquet" for key in keys}
    begun, pids = runs_of(tmp_path)
    assert len(pids) == 2
    # Only the cell that was cut ran again; the one before it on the same recording had its record.
    assert begun == {int(dict(c.overrides)["draw"]): 1 for c in study.cells} | {21: 2}
    done = [now.cells for now in seen]
    assert done == sorted(done) and (done[0], done[-1], seen[-1].workers) == (0, 18, 2)


def test_a_worker_that_joins_late_takes_over(cluster, tmp_path):
    """The last worker dies, the study waits, and goes on with the next one that comes."""
    wait_until(lambda: cluster.workers() >= 1)
    study = slow_study(tmp_path, 2, killer=(1, "truth"))
    victims = cluster.workers()
    study_outcome = []
    running = Thread(target=lambda: study_outcome.append(run_study(study, tmp_path, scheduler=cluster.address)))
    running.start()
    wait_until((tmp_path / "killed").exists)
    wait_until(lambda: cluster.workers() < victims)
    late = cluster.add_worker()
    running.join(60.0)
    (outcome,) = study_outcome
    assert len(outcome.records) == 6 and not outcome.errors and not outcome.missing
    assert late.pid in runs_of(tmp_path)[1]
    late.send_signal(signal.SIGTERM)


def test_a_scheduler_without_workers_or_none_at_all_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "_PATIENCE_S", 0.1)
    with (
        LocalCluster(n_workers=0, processes=False, dashboard_address=":0") as empty,
        pytest.raises(StudyError, match="has no workers"),
    ):
        run_study(Study("none", (cell(),)), tmp_path, scheduler=empty.scheduler_address)
    with pytest.raises(StudyError, match="no Dask scheduler at 'nonsense://1'"):
        run_study(Study("none", (cell(),)), tmp_path, scheduler="nonsense://1")


def test_workers_that_cannot_do_it_are_named_before_anything_runs(tmp_path, monkeypatch):
    options = {"n_workers": 1, "processes": False, "dashboard_address": ":0"}
    with (
        LocalCluster(**options, threads_per_worker=2) as wide,
        pytest.raises(StudyError, match=r"worker .* has 2 threads; expected 1"),
    ):
        run_study(Study("wide", (cell(),)), tmp_path, scheduler=wide.scheduler_address)
    monkeypatch.setattr(workplace, "_versions_here", lambda estimators, priors: {"numpy": "0.1"})
    with (
        LocalCluster(**options, threads_per_worker=1) as old,
        pytest.raises(StudyError, match=r"worker .* runs other versions than the study: .*numpy 0\.1 instead of"),
    ):
        run_study(Study("old", (cell(),)), tmp_path, scheduler=old.scheduler_address)
    assert not (tmp_path / "cells").exists()


def test_a_worker_with_other_versions_that_comes_late_does_nothing(tmp_path):
    place = workplace.Workplace({"numpy": "0.1"}, (), (), tmp_path)
    with pytest.raises(StudyError, match="a worker runs other versions"):
        module._batch([cell()], place, None)
    with pytest.raises(StudyError, match="does not see the study's folder"):
        module._batch([cell()], workplace.Workplace({}, (), (), tmp_path / "elsewhere"), None)
    assert not (tmp_path / "cells").exists()


def test_two_that_run_the_same_cell_leave_one_record(tmp_path, monkeypatch):
    """A worker that was given up for dead may still be at it, even with the same process number elsewhere."""
    key, write = cell().key({}), records.pq.write_table

    def overtaken(table, path, **options):
        monkeypatch.setattr(records.pq, "write_table", write)
        write(table, path, **options)
        records.write(records.Record(key, "first", {}, {}), tmp_path)

    monkeypatch.setattr(records.pq, "write_table", overtaken)
    records.write(records.Record(key, "second", {}, {}), tmp_path)
    assert [p.name for p in (tmp_path / "cells").iterdir()] == [f"{key}.parquet"]
    assert records.read(records.path_of(tmp_path, key)).title == "second"
