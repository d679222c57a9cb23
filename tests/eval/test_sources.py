import fcntl
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from threading import Thread

import numpy as np
import pytest

from eval import flights
from eval.cells import described
from eval.errors import StudyError
from eval.flights import Flight, PointsFlight, RenderedFlight
from eval.sources import Degraded, Recording, rendered, restored, to_render
from sim.errors import ConfigError
from tests.eval.processes import wait_until

SHORT = Flight("quadrotor", 1.0, 1)
ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def workspace(tmp_path_factory):
    """A folder in which one flight is rendered."""
    folder = tmp_path_factory.mktemp("films")
    RenderedFlight.of(SHORT).make(folder)
    return folder


def test_a_points_flight_is_degraded_on_the_same_motion(tmp_path):
    flight = Flight("quadrotor", 4.0, 1)
    clean, dark = PointsFlight(flight).load(tmp_path), PointsFlight(flight, "blackout@1-2").load(tmp_path)
    other = PointsFlight(flight, noise_seed=1).load(tmp_path)
    np.testing.assert_array_equal(clean.truth.p_WB, dark.truth.p_WB)
    np.testing.assert_array_equal(clean.imu.gyro, dark.imu.gyro)
    np.testing.assert_array_equal(clean.truth.p_WB, other.truth.p_WB)
    assert not np.array_equal(clean.imu.gyro, other.imu.gyro)
    seen = [len(f.tracks[0]) for f in dark.frames]
    assert max(seen[21:39]) == 0 < min(seen[:19])


def test_what_a_source_is_comes_back_from_its_description():
    film = RenderedFlight.of(SHORT, "motion_blur:2@0.2-0.5")
    for source in (PointsFlight(SHORT, "blackout@0.2-0.5", 3), film, Degraded(film, "blackout@0.2-0.5", 1)):
        assert restored(described(source)) == source
    assert restored(described(Recording("/somewhere", 10, "abc"))) == Recording("/somewhere", 10, "abc")
    with pytest.raises(StudyError, match=r"'FakeFlight' is unknown; known are .*PointsFlight"):
        restored({"kind": "FakeFlight", "seed": 1})


def test_only_what_happens_inside_the_camera_is_rendered_anew():
    clean = RenderedFlight.of(SHORT)
    assert rendered(SHORT, "") == clean
    assert rendered(SHORT, "low_light:3@0.2-0.5") == Degraded(clean, "low_light:3@0.2-0.5", 1)
    both = rendered(SHORT, "low_light:3@0.2-0.5, motion_blur:2@0.1-0.3")
    assert isinstance(both, Degraded) and both.clean.degrade == "motion_blur:2@0.1-0.3"
    assert to_render(both) == both.clean and to_render(PointsFlight(SHORT)) is None


def test_a_rendered_flight_is_made_once_and_degraded_when_it_is_read(workspace):
    film = RenderedFlight.of(SHORT)
    folder = film.folder(workspace)
    stamps = {p: p.stat().st_mtime_ns for p in folder.rglob("*")}
    film.make(workspace)
    assert {p: p.stat().st_mtime_ns for p in folder.rglob("*")} == stamps
    clean, dark = film.load(workspace), rendered(SHORT, "blackout@0.4-0.6").load(workspace)
    assert len(clean.frames) == len(dark.frames) > 15
    light = [[frame.images[0].load().mean() for frame in seen.frames] for seen in (clean, dark)]
    assert light[0][2] == light[1][2] and light[1][10] < 0.2 * light[0][10]
    assert film.folder(workspace) != replace(film, simulator="another").folder(workspace)
    with pytest.raises(StudyError, match="was not made"):
        RenderedFlight.of(replace(SHORT, seed=2)).load(workspace)


def test_a_rendering_that_is_killed_is_nowhere_and_goes_on(workspace, tmp_path):
    """Cut by SIGKILL after twelve images; those are kept, and the folder comes out as if nothing had happened."""
    script = (
        "import os, signal, sys; from pathlib import Path; from eval.flights import Flight, RenderedFlight\n"
        "def cut(done, total): done == 12 and os.kill(os.getpid(), signal.SIGKILL)\n"
        "RenderedFlight.of(Flight('quadrotor', 1.0, 1)).make(Path(sys.argv[1]), cut)"
    )
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    killed = subprocess.run([sys.executable, "-c", script, str(tmp_path)], env=environment, check=False)
    assert killed.returncode == -9
    film, done = RenderedFlight.of(SHORT), []
    assert not film.folder(tmp_path).exists()
    (partial,) = (tmp_path / "recordings").iterdir()
    kept = {p.name: p.stat().st_mtime_ns for p in partial.rglob("*.png")}
    assert len(kept) >= 11
    film.make(tmp_path, lambda *now: done.append(now))
    assert [p.name for p in (tmp_path / "recordings").iterdir()] == [film.folder(tmp_path).name]
    assert done[-1][0] == done[-1][1]
    ours, whole = film.folder(tmp_path), film.folder(workspace)
    assert {p.name: p.stat().st_mtime_ns for p in ours.rglob("*.png")}.items() >= kept.items()
    files = sorted(p.relative_to(whole) for p in whole.rglob("*") if p.is_file())
    assert files == sorted(p.relative_to(ours) for p in ours.rglob("*") if p.is_file())
    assert all((ours / f).read_bytes() == (whole / f).read_bytes() for f in files)


def test_two_that_render_the_same_flight_wait_for_each_other(tmp_path, monkeypatch):
    monkeypatch.setattr(flights, "_BUSY_S", 0.05)
    film = RenderedFlight.of(SHORT)
    folder = film.folder(tmp_path)
    partial = folder.with_name(folder.name + ".partial")
    partial.mkdir(parents=True)
    tries = []
    render = RenderedFlight._render
    monkeypatch.setattr(RenderedFlight, "_render", lambda *a: (tries.append(1), render(*a)))
    with (partial / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        waiting = Thread(target=film.make, args=(tmp_path,))
        waiting.start()
        wait_until(lambda: len(tries) >= 2)
        assert not folder.exists()
        (partial / "mav0").mkdir()
        partial.rename(folder)  # the other one is through
    waiting.join(30.0)
    assert not waiting.is_alive() and [p.name for p in folder.iterdir() if p.is_dir()] == ["mav0"]


def test_a_rendering_that_fails_says_why(tmp_path):
    with pytest.raises(ConfigError, match="'boat' is unknown"):
        RenderedFlight.of(replace(SHORT, platform="boat")).make(tmp_path)
    assert not list(tmp_path.rglob("*.png"))


def test_a_recording_is_known_by_what_it_holds(workspace):
    film = RenderedFlight.of(SHORT)
    folder, sequence = film.folder(workspace), film.load(workspace)
    found = Recording.of(folder, sequence)
    assert found.name == folder.name and Path(found.path).is_absolute() and found.frames == len(sequence.frames)
    assert Recording.of(folder / "mav0", sequence).name == folder.name
    assert found == Recording.of(folder, sequence)
    assert found.digest != Recording.of(folder, sequence.span(0.2)).digest
    assert len(found.load(workspace).imu) == len(sequence.imu)


def test_truth_calibration_and_images_are_part_of_a_recording(workspace, tmp_path):
    film = RenderedFlight.of(SHORT)
    sequence = film.load(workspace)
    truth, camera = sequence.truth, sequence.calibration.cameras[0]
    turned = replace(sequence.calibration, cameras=(replace(camera, dt_cam_imu=0.01),))
    first = sequence.frames[0].images[0]
    larger = tmp_path / "larger.png"
    larger.write_bytes(first.path.read_bytes() + b"more")
    frames = (replace(sequence.frames[0], images={0: replace(first, path=larger)}), *sequence.frames[1:])
    others = (
        replace(sequence, truth=replace(truth, p_WB=truth.p_WB + 1.0)),
        replace(sequence, truth=None),
        replace(sequence, calibration=turned),
        replace(sequence, frames=frames),
    )
    digests = [Recording.of(film.folder(workspace), s).digest for s in (sequence, *others)]
    assert len(set(digests)) == len(digests)
