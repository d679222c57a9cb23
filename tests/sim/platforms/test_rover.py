import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt, welch

from navcore.arrays import Vectors
from sim import simulate_motion
from sim.errors import ConfigError
from sim.motion import Motion
from sim.platforms import DIFFICULTIES
from sim.platforms.course import Going
from sim.platforms.ground import Ground
from sim.platforms.rover import DRIVES, RoverDrive, drive

REST = 1990
DRIVING = slice(4000, None)


@pytest.fixture(scope="module")
def drives() -> dict[str, list[Motion]]:
    """Of half a minute each, by difficulty."""
    return {d: [simulate_motion("rover", 30.0, seed, difficulty=d) for seed in (1, 2)] for d in DIFFICULTIES}


def body_velocity(motion: Motion) -> Vectors:
    return (np.swapaxes(motion.R_WB, 1, 2) @ motion.v_WB[..., None])[..., 0]


def shaking(motion: Motion) -> float:
    """Rms of the vertical specific force above 5 Hz [m/s^2]."""
    above = butter(4, 5.0, "highpass", fs=1.0 / motion.step_s, output="sos")
    return float(np.std(sosfiltfilt(above, motion.specific_force_B[DRIVING, 2])))


@pytest.mark.parametrize("difficulty", DIFFICULTIES)
def test_it_stands_still_on_any_ground_before_it_sets_off(drives: dict[str, list[Motion]], difficulty: str) -> None:
    for motion in drives[difficulty]:
        assert np.abs(motion.v_WB[:REST]).max() < 3e-4
        assert np.abs(motion.omega_B[:REST]).max() < 3e-4
        assert motion.specific_force_B[:REST].std(axis=0).max() < 3e-4
        assert np.linalg.norm(motion.specific_force_B[:REST], axis=1).mean() == pytest.approx(9.81, abs=1e-4)
        assert np.linalg.norm(motion.v_WB[3000], axis=0) > 0.2


@pytest.mark.parametrize(
    ("difficulty", "speed", "slip"), [("easy", 0.6, 0.01), ("medium", 0.9, 0.02), ("difficult", 1.3, 0.04)]
)
def test_it_neither_slips_aside_nor_turns_over(
    drives: dict[str, list[Motion]], difficulty: str, speed: float, slip: float
) -> None:
    for motion in drives[difficulty]:
        forward, aside, up = np.sqrt((body_velocity(motion)[DRIVING] ** 2).mean(axis=0))
        assert forward == pytest.approx(speed, rel=0.25)
        assert 0.1 * slip < aside / forward < slip
        assert up / forward < slip
        assert np.abs(body_velocity(motion)[DRIVING].mean(axis=0)[1:]).max() < 0.01
        assert np.abs(motion.omega_B[DRIVING, :2].mean(axis=0)).max() < 0.02


@pytest.mark.parametrize("difficulty", DIFFICULTIES)
def test_it_stays_in_the_free_part_of_the_room_and_on_its_wheels(
    drives: dict[str, list[Motion]], difficulty: str
) -> None:
    for motion in drives[difficulty]:
        assert np.all(np.abs(motion.p_WB[:, :2]).max(axis=0) < (4.0, 3.0))
        assert motion.length > 12.5
        assert np.abs(motion.p_WB[:, 2] - 0.35).max() < 0.04
        assert motion.R_WB[:, 2, 2].min() > np.cos(np.deg2rad(6.0))


def test_rougher_ground_shakes_it_more(drives: dict[str, list[Motion]]) -> None:
    easy, medium, difficult = (np.mean([shaking(m) for m in drives[d]]) for d in DIFFICULTIES)
    assert 0.01 < easy < 0.04
    assert 4.0 * easy < medium
    assert 2.0 * medium < difficult < 1.5


def test_roughness_alone_shakes_it() -> None:
    smooth = RoverDrive(DRIVES["difficult"].going, 0.0)
    assert shaking(drive(10.0, np.random.default_rng(1), smooth)) < 0.1
    assert shaking(drive(10.0, np.random.default_rng(1), DRIVES["difficult"])) > 0.4


def test_the_same_seed_drives_the_same_way_another_seed_another() -> None:
    one, again, other = (simulate_motion("rover", 4.0, seed) for seed in (7, 7, 8))
    assert one.p_WB.tobytes() == again.p_WB.tobytes()
    assert one.specific_force_B.tobytes() == again.specific_force_B.tobytes()
    assert np.abs(one.p_WB - other.p_WB).max() > 0.1


def test_a_start_in_motion_begins_in_full_drive() -> None:
    motion = simulate_motion("rover", 3.0, 1, moving_start=True)
    assert motion.duration_s == pytest.approx(3.0)
    assert body_velocity(motion)[0, 0] > 0.4


def test_ground_has_the_spectrum_it_is_said_to_have() -> None:
    step, roughness = 0.01, 100e-6
    ground = Ground(roughness, np.random.default_rng(1))
    along = np.arange(0.0, 5.12, step)
    heights = np.stack([ground.at(along, np.full_like(along, y))[:, 0] for y in np.arange(0.0, 5.12, 0.08)])
    n, density = welch(heights, 1.0 / step, nperseg=len(along), window="boxcar", detrend=False)
    band = (n > 0.5) & (n < 6.0)
    share = density.mean(axis=0)[band] / (roughness * (n[band] / 0.1) ** -2.0)
    assert np.exp(np.log(share).mean()) == pytest.approx(1.0, abs=0.15)
    assert abs(np.polyfit(np.log(n[band]), np.log(share), 1)[0]) < 0.2


def test_slopes_of_the_ground_are_those_of_its_heights_also_across_the_edges_of_a_tile() -> None:
    ground, h = Ground(100e-6, np.random.default_rng(2)), 0.001
    along, aside = np.arange(-5.5, 5.5, h), np.full(11000, -0.73)
    for x, y, axis in ((along, aside, 1), (aside, along, 2)):
        there = ground.at(x, y)
        rise, slope = np.diff(there[:, 0]) / h, there[:-1, axis]
        assert np.abs(rise - slope).max() < 0.5 * np.std(slope)


def test_ground_too_rough_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"roughness is 0\.1 m"):
        RoverDrive(Going((2.7, 1.6), 1.0, 0.7, 1.0, 0.25), 0.1)
