import numpy as np
import pytest
from evo.tools import file_interface
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from navcore.errors import DataError
from navcore.trajectory import Trajectory

START_NS = 1_403_636_579_758_555_392
UNIT = [0.0, 0.0, 0.0, 1.0]


def path(n=5, seed=0, step_ns=50_000_001):
    rng = np.random.default_rng(seed)
    q = Rotation.random(n, rng=rng).as_quat()
    v, b_g, b_a = rng.normal(size=(3, n, 3))
    return Trajectory(START_NS + step_ns * np.arange(n), q, rng.normal(size=(n, 3)), v, b_g, b_a)


def test_evo_reads_our_tum_file(tmp_path):
    ours = path(20)
    ours.to_tum(tmp_path / "trajectory.tum")
    theirs = file_interface.read_tum_trajectory_file(str(tmp_path / "trajectory.tum"))
    np.testing.assert_allclose(theirs.timestamps, ours.t_ns * 1e-9, rtol=1e-15)
    np.testing.assert_allclose(theirs.positions_xyz, ours.p_WB, atol=1e-9)
    q_wxyz = theirs.orientations_quat_wxyz
    np.testing.assert_allclose(np.roll(q_wxyz, -1, axis=1), ours.q_WB, atol=1e-8)


@given(st.integers(0, 2**62), st.lists(st.integers(1, 10**11), max_size=8))
def test_tum_keeps_every_nanosecond(tmp_path_factory, start, steps):
    t_ns = np.cumsum([start, *steps])
    n = len(t_ns)
    file = tmp_path_factory.mktemp("tum") / "t.tum"
    Trajectory(t_ns, np.tile(UNIT, (n, 1)), np.zeros((n, 3))).to_tum(file)
    np.testing.assert_array_equal(Trajectory.from_tum(file).t_ns, t_ns)


@pytest.mark.parametrize(
    ("stamp", "t_ns"),
    [("12", 12_000_000_000), ("1.5", 1_500_000_000), ("1.5e0", 1_500_000_000), ("0.0000000019", 1)],
)
def test_stamps_as_others_write_them(tmp_path, stamp, t_ns):
    file = tmp_path / "t.tum"
    file.write_text(f"# t x y z qx qy qz qw\n\n{stamp} 0 0 0 0 0 0 1\n")
    assert Trajectory.from_tum(file).t_ns.tolist() == [t_ns]


@pytest.mark.parametrize("line", ["1.0 0 0 0 0 0 1", "1.0 a 0 0 0 0 0 1", "x 0 0 0 0 0 0 1", "1 0 0 0 0 0 0 1 9"])
def test_a_wrong_line_is_named(tmp_path, line):
    file = tmp_path / "t.tum"
    file.write_text(f"0.5 0 0 0 0 0 0 1\n{line}\n")
    with pytest.raises(DataError, match=r"t\.tum:2: expected 't x y z qx qy qz qw'"):
        Trajectory.from_tum(file)


def test_a_wrong_pose_in_a_file_names_the_file(tmp_path):
    file = tmp_path / "t.tum"
    file.write_text("0.5 0 0 0 0 0 0 1\n0.4 0 0 0 0 0 0 1\n")
    with pytest.raises(DataError, match=r"t\.tum: pose stamp 400000000 ns does not follow"):
        Trajectory.from_tum(file)
    with pytest.raises(DataError, match=r"gone\.tum: no such file"):
        Trajectory.from_tum(tmp_path / "gone.tum")


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"t_ns": [1, 1]}, "pose stamp 1 ns does not follow 1 ns"),
        ({"p_WB": np.full((2, 3), np.nan)}, "pose at 1 ns is not one"),
        ({"q_WB": np.zeros((2, 4))}, "pose at 1 ns is not one"),
        ({"q_WB": np.full((2, 4), np.nan)}, "pose at 1 ns is not one"),
        ({"p_WB": np.zeros((3, 3))}, r"p_WB has shape \(3, 3\), expected \(2, 3\)"),
        ({"b_g": np.zeros(3)}, r"b_g has shape \(3,\), expected \(2, 3\)"),
    ],
)
def test_wrong_trajectories_are_refused(change, says):
    good = {"t_ns": [1, 2], "q_WB": np.tile(UNIT, (2, 1)), "p_WB": np.zeros((2, 3))}
    with pytest.raises(DataError, match=says):
        Trajectory(**{**good, **change})


@given(st.floats(0.0, 1.0))
def test_interpolation_turns_at_constant_rate(share):
    start, turn = Rotation.from_rotvec([0.3, 0.1, 0.2]), np.array([0.5, -0.4, 0.9])
    q_WB = np.stack([start.as_quat(), (start * Rotation.from_rotvec(turn)).as_quat()])
    ends = Trajectory([0, 10**9], q_WB, [[0, 0, 0], [1, 2, 3]], None, [[0, 0, 0], [2, 0, 0]])
    t_ns = round(share * 1e9)
    state = ends.at(np.array([t_ns]))
    expected = start * Rotation.from_rotvec(t_ns * 1e-9 * turn)
    assert (Rotation.from_quat(state.q_WB[0]).inv() * expected).magnitude() < 1e-12
    np.testing.assert_allclose(state.p_WB[0], t_ns * 1e-9 * np.array([1.0, 2.0, 3.0]), atol=1e-12)
    np.testing.assert_allclose(state.b_g[0, 0], 2.0 * t_ns * 1e-9, atol=1e-12)
    assert state.v_WB is None


def test_interpolation_gives_back_the_states_and_stops_at_the_ends():
    states = path()
    again = states.at(states.t_ns)
    np.testing.assert_allclose(again.p_WB, states.p_WB, atol=1e-12)
    np.testing.assert_allclose(again.R_WB, states.R_WB, atol=1e-12)
    outside = states.at(np.array([0, 2 * START_NS]))
    np.testing.assert_allclose(outside.p_WB, states.p_WB[[0, -1]], atol=1e-12)
    single = states[:1].at(np.array([5, 6]))
    np.testing.assert_array_equal(single.p_WB, states.p_WB[[0, 0]])
    with pytest.raises(DataError, match="empty"):
        states[:0].at(np.array([1]))


def test_covers_knows_gaps_and_near_stamps():
    states = Trajectory([0, 10**8, 10**9], np.tile(UNIT, (3, 1)), np.zeros((3, 3)))
    asked = np.array([-2000, -256, 0, 5 * 10**7, 10**8 + 256, 5 * 10**8, 10**9 + 256, 2 * 10**9])
    expected = [False, True, True, True, True, False, True, False]
    np.testing.assert_array_equal(states.covers(asked), expected)
    np.testing.assert_array_equal(states.covers(asked, max_gap_ns=10**9)[5], True)
    assert not states[:0].covers(asked).any()


def test_parts_and_length():
    states = Trajectory([0, 1, 2, 5], np.tile(UNIT, (4, 1)), [[0, 0, 0], [3, 4, 0], [3, 4, 0], [3, 4, 2]])
    assert states.length == 7.0
    assert states.between(1, 5).t_ns.tolist() == [1, 2]
    assert states[np.array([True, False, False, True])].t_ns.tolist() == [0, 5]
    np.testing.assert_allclose(states.seconds, [0.0, 1e-9, 2e-9, 5e-9])


def test_a_file_that_cannot_be_written_is_not_left_half(tmp_path):
    target = tmp_path / "folder" / "t.tum"
    with pytest.raises(FileNotFoundError):
        path().to_tum(target)
    path().to_tum(tmp_path / "t.tum")
    assert [x.name for x in tmp_path.iterdir()] == ["t.tum"]
