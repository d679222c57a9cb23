import numpy as np

from sim.streams import Streams


def test_no_two_streams_of_a_seed_are_the_same() -> None:
    first = [
        generator.standard_normal()
        for noise_seed in (None, 0, 1, 2)
        for generator in vars(Streams.of(1, noise_seed)).values()
    ]
    # Motion and world are the same whatever the noise seed; IMU and vision never are.
    assert len(set(first)) == 2 + 2 * 4


def test_a_noise_seed_keeps_motion_and_world() -> None:
    plain, other = Streams.of(3), Streams.of(3, 5)
    np.testing.assert_array_equal(plain.motion.standard_normal(9), other.motion.standard_normal(9))
    np.testing.assert_array_equal(plain.world.standard_normal(9), other.world.standard_normal(9))
