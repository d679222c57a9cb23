import numpy as np
import pytest

from sim import simulate_motion
from sim.errors import ConfigError
from sim.motion import Motion
from sim.platforms.quadrotor import QuadrotorFlight
from sim.world.scenes.room import SIZE as ROOM_SIZE


def test_it_stands_still_then_takes_off_and_flies(flight: Motion) -> None:
    standing = slice(0, 1990)
    assert np.abs(flight.v_WB[standing]).max() < 1e-5
    np.testing.assert_allclose(flight.specific_force_B[standing].mean(axis=0), [0.0, 0.0, 9.81], atol=1e-3)
    speed = np.linalg.norm(flight.v_WB[6000:], axis=1)
    assert 0.8 < speed.mean() < 2.0
    assert speed.max() < 3.5


def test_it_stays_in_the_room_away_from_walls_and_clutter() -> None:
    for seed in range(6):
        p = simulate_motion("quadrotor", 30.0, seed).p_WB
        assert np.all(np.abs(p[:, :2]).max(axis=0) < 0.5 * np.array(ROOM_SIZE[:2]) - 1.0)
        assert p[6000:, 2].min() > 0.8
        assert p[:, 2].max() < 3.3


def test_force_across_thrust_is_linear_drag(flight: Motion) -> None:
    flying = slice(6000, None)
    v_B = (np.swapaxes(flight.R_WB, 1, 2) @ flight.v_WB[..., None])[:-1, :, 0][flying]
    for axis in (0, 1):
        slope, offset = np.polyfit(v_B[:, axis], flight.specific_force_B[flying, axis], 1)
        assert slope == pytest.approx(-0.16, abs=0.01)
        assert offset == pytest.approx(0.0, abs=0.01)


def test_the_same_seed_flies_the_same_path_another_seed_another() -> None:
    one, again, other = (simulate_motion("quadrotor", 4.0, seed) for seed in (7, 7, 8))
    np.testing.assert_array_equal(one.p_WB, again.p_WB)
    np.testing.assert_array_equal(one.specific_force_B, again.specific_force_B)
    assert np.abs(one.p_WB - other.p_WB).max() > 0.1


def test_a_start_in_motion_begins_in_full_flight() -> None:
    motion = simulate_motion("quadrotor", 3.0, 1, moving_start=True)
    assert motion.duration_s == pytest.approx(3.0)
    assert motion.p_WB[0, 2] > 0.5
    assert np.linalg.norm(motion.v_WB[0]) > 0.3


def test_bad_requests_are_refused_with_what_is_allowed() -> None:
    with pytest.raises(ConfigError, match=r"'boat' is unknown; known are \['handheld', 'quadrotor', 'rover'\]"):
        simulate_motion("boat")
    with pytest.raises(ConfigError, match="expected a time above 0"):
        simulate_motion("quadrotor", 0.0)
    with pytest.raises(ConfigError, match="speed is 9"):
        QuadrotorFlight(speed=9.0)
    with pytest.raises(ConfigError, match="seeds are -1"):
        simulate_motion("quadrotor", 1.0, -1)
