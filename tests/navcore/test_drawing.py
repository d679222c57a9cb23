import sys
from dataclasses import replace

import numpy as np
import pytest
from rerun import RecordingStream
from rerun.chunk import RrdReader

from navcore import so3
from navcore.calibration import Calibration
from navcore.drawing import Canvas, Drawn, canvas, open_stream
from navcore.drawing.canvas import ellipsoid
from navcore.errors import ConfigError
from navcore.odometry import Estimate, Health, State
from navcore.sequence import Frame, ImageFile, Tracks
from navcore.trajectory import Trajectory
from tests.navcore.recordings import sequence

SEEN = {0: Tracks(np.array([3, 8]), np.array([[10.0, 20.0], [30.0, 40.0]]))}


class Follower:
    """Answers a frame at once: the first without a pose, then along a line, with biases that are known to a spread."""

    def __init__(self) -> None:
        self.tracks = SEEN
        self._seen = 0

    def add_imu(self, samples):
        return []

    def add_frame(self, frame):
        self._seen += 1
        if self._seen == 1:
            return [Estimate(frame.t_ns, Health.INITIALISING, ("not yet",))]
        R_WB, p_WB = so3.exp(np.array([0.0, 0.0, 0.5])), np.array([0.1 * self._seen, 0.0, 0.0])
        P = np.diag(np.repeat([0.1, 0.2, 0.3, 0.4, 0.5], 3) ** 2)
        state = State(R_WB, p_WB, np.zeros(3), np.full(3, 0.01), np.full(3, 0.02), P)
        return [Estimate(frame.t_ns, Health.TRACKING, (), state, 2, 1)]

    def finish(self):
        return []


@pytest.fixture
def recording():
    """Ten frames with images of zeros and a truth that stands still at the origin, heading 0."""
    return sequence(biases=True)


def drawn(recording, path, **options):
    """What is in the file of a run, as {entity: [(seconds or None, {column: values})]}."""
    stream = open_stream(recording.name, cameras=1, file=path)
    odometry = Drawn(Follower(), Canvas(stream, recording.calibration, 1, options.get("truth", recording.truth)))
    answers = [odometry.add_frame(frame) for frame in recording.frames]
    stream.disconnect()
    assert [len(a) for a in answers] == [1] * len(recording.frames)
    return read(path)


def read(path):
    found = {}
    for chunk in RrdReader(path).stream().to_chunks():
        table = chunk.to_record_batch().to_pydict()
        times = table.get("time", [None] * chunk.num_rows)
        for k in range(chunk.num_rows):
            row = {name: values[k] for name, values in table.items() if values[k] is not None}
            seconds = None if times[k] is None else times[k].total_seconds()
            found.setdefault(chunk.entity_path, []).append((seconds, row))
    return {entity: sorted(rows, key=lambda row: (row[0] is not None, row[0])) for entity, rows in found.items()}


def values(rows, column):
    """Of the rows that have it, in time order."""
    return [row[name] for _, row in rows for name in row if name.endswith(column)]


def test_a_run_can_be_read_back(recording, tmp_path):
    found = drawn(recording, tmp_path / "run.rrd")
    n = len(recording.frames)
    times = [t for t, _ in found["/world/body/cam0/image"]]
    np.testing.assert_allclose(times, 0.05 * np.arange(n), atol=1e-9)
    np.testing.assert_allclose(values(found["/world/body/cam0/now"], ":positions")[0], SEEN[0].uv)
    assert [len(s) for s in values(found["/world/body/cam0/lately"], ":strips")[3]] == [4, 4]  # of four frames
    steps = np.array(values(found["/world/path"], ":strips"))[:, 0]
    np.testing.assert_allclose(steps[:, 1, 0] - steps[:, 0, 0], 0.1, atol=1e-6)
    assert len(steps) == n - 2  # from the second pose on
    assert values(found["/health"], ":state") == [["INITIALISING"], ["TRACKING"]]
    assert values(found["/reasons"], ":text") == [["INITIALISING: not yet"]]
    assert values(found["/features"], ":scalars")[1] == [2.0, 1.0]


def test_spreads_are_three_sigma_and_truth_is_beside_them(recording, tmp_path):
    found = drawn(recording, tmp_path / "run.rrd")
    np.testing.assert_allclose(values(found["/world/spread"], ":half_sizes")[0], [[0.6, 0.6, 0.6]], rtol=1e-6)
    np.testing.assert_allclose(values(found["/biases/b_g/y"], ":scalars")[0], [0.01, 1.21, -1.19, 0.002])
    np.testing.assert_allclose(values(found["/biases/b_a/z"], ":scalars")[0], [0.02, 1.52, -1.48, 0.03])


def test_truth_goes_through_the_first_pose_with_its_heading(recording, tmp_path):
    truth = recording.truth
    moving = np.outer(np.arange(len(truth)), [0.01, 0.0, 0.0])
    found = drawn(recording, tmp_path / "run.rrd", truth=replace(truth, p_WB=moving))
    steps = np.array(values(found["/world/truth"], ":strips"))[:, 0]
    np.testing.assert_allclose(steps[0, 0], [0.2, 0.0, 0.0], atol=1e-6)
    along = steps[-1, 1] - steps[0, 0]
    assert np.arctan2(along[1], along[0]) == pytest.approx(0.5, abs=1e-6)


@pytest.mark.parametrize("known", [None, "no biases", "elsewhere"])
def test_what_truth_does_not_know_is_not_drawn(known, recording, tmp_path):
    truth = recording.truth
    given = {
        None: None,
        "no biases": Trajectory(truth.t_ns, truth.q_WB, truth.p_WB),
        "elsewhere": replace(truth, t_ns=truth.t_ns + 10**12),
    }[known]
    found = drawn(recording, tmp_path / "run.rrd", truth=given)
    lines = values(found["/biases/b_g/x"], ":scalars")[0]
    assert len(lines) == 3 if known is None else len(lines) == 4 and np.isnan(lines[3])
    assert ("/world/truth" in found) == (known == "no biases")


def test_an_image_that_cannot_be_had_is_left_out(recording, tmp_path):
    gone = ImageFile(tmp_path / "gone.png", 64, 48)
    frames = (Frame(recording.frames[0].t_ns, {0: gone}), Frame(recording.frames[1].t_ns), *recording.frames[2:])
    found = drawn(replace(recording, frames=frames), tmp_path / "run.rrd")
    assert len(found["/world/body/cam0/image"]) == len(frames) - 2


def test_an_ellipsoid_has_the_axes_of_its_covariance():
    R = so3.exp(np.array([0.3, -0.5, 1.1]))
    half_sizes, quaternion = ellipsoid(R @ np.diag([1.0, 4.0, 9.0]) @ R.T)
    np.testing.assert_allclose(half_sizes, [3.0, 6.0, 9.0])
    axes = so3.from_quaternion(quaternion)
    np.testing.assert_allclose(np.abs(axes.T @ R), np.eye(3), atol=1e-12)
    assert np.linalg.det(axes) == pytest.approx(1.0)
    assert np.isfinite(ellipsoid(np.zeros((3, 3)))[0]).all()


def test_answers_that_come_together_belong_to_their_frames(recording, tmp_path):
    class Late(Follower):
        def add_frame(self, frame):
            self.kept = [*getattr(self, "kept", []), *super().add_frame(frame)]
            return []

        def finish(self):
            return self.kept

    stream = open_stream("late", cameras=1, file=tmp_path / "run.rrd")
    odometry = Drawn(Late(), Canvas(stream, recording.calibration, 1))
    assert [odometry.add_frame(frame) for frame in recording.frames] == [[]] * len(recording.frames)
    assert odometry.add_imu(recording.imu) == []
    assert [e.t_ns for e in odometry.finish()] == [f.t_ns for f in recording.frames]
    stream.disconnect()
    found = read(tmp_path / "run.rrd")
    assert len(found["/world/body/cam0/image"]) == len(recording.frames)
    assert [len(x) for x in values(found["/world/body/cam0/now"], ":positions")][-2:] == [0, 2]


def test_a_drawing_needs_somewhere_to_go(tmp_path):
    with pytest.raises(ConfigError, match="neither viewer nor file"):
        open_stream("run", cameras=1)
    with pytest.raises(ConfigError, match=r"gone/run.rrd: no such folder"):
        open_stream("run", cameras=1, file=tmp_path / "gone" / "run.rrd")


def test_a_viewer_that_is_gone_does_not_end_the_run(recording, monkeypatch):
    warnings = []
    monkeypatch.setattr(canvas._LOG, "warning", lambda text, *values: warnings.append(text % values))

    class Gone:
        def __getattr__(self, name):
            return lambda *args, **kwargs: None

        def flush(self, timeout_sec):
            raise RuntimeError("connection severed")

    odometry = Drawn(Follower(), Canvas(Gone(), recording.calibration, 1, recording.truth))
    assert len(odometry.add_frame(recording.frames[0])) == 1 and odometry.finish() == []
    assert warnings == ["not all of the drawing arrived: connection severed"]


def test_where_no_viewer_answers_is_said_at_once(monkeypatch):
    def severed(self, timeout_sec):
        raise RuntimeError("timed out")

    monkeypatch.setattr(RecordingStream, "spawn", lambda self, connect: None)
    monkeypatch.setattr(RecordingStream, "set_sinks", lambda self, *sinks, **options: None)
    monkeypatch.setattr(RecordingStream, "flush", severed)
    with pytest.raises(ConfigError, match="no viewer answers"):
        open_stream("run", cameras=1, viewer=True)


def test_without_the_sdk_the_error_says_how_to_get_it(monkeypatch):
    for name in [name for name in sys.modules if name.startswith("navcore.drawing")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(ConfigError, match=r"pip install 'msckf-ipnet\[viz\]'"):
        import navcore.drawing  # noqa: F401


def test_a_rig_without_cameras_can_be_drawn(recording, tmp_path):
    stream = open_stream("blind", cameras=0, file=tmp_path / "run.rrd")
    blind = Canvas(stream, Calibration(recording.calibration.imu), 0)
    blind.add(Frame(5), Estimate(5, Health.LOST, ("nothing to see",)), {})
    stream.disconnect()
    assert values(read(tmp_path / "run.rrd")["/health"], ":state") == [["LOST"]]
