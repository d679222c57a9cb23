"""Motion blur of sharp images, against the length that rate, exposure and focal length give."""

import numpy as np
import pytest

from sim.camera.exposure import EXPOSURE_S
from tests.sim.degrade.recordings import FOCAL, HEIGHT, RATE, WIDTH, degraded, flat, turning


def test_a_line_is_as_wide_as_the_turn_during_the_exposure() -> None:
    """Second moment: a box of length L has variance L^2 / 12."""
    image = flat(0)
    image[:, WIDTH // 2] = 255
    for severity in (3, 5):
        seen = degraded(turning(image, frames=20), f"motion_blur:{severity}@0-1", 5)[
            HEIGHT // 2 - 20 : HEIGHT // 2 + 20
        ]
        linear = ((seen / 255.0) ** 2.2 * (seen > 25)).mean(axis=0)
        u = np.arange(WIDTH) - WIDTH // 2
        mean = np.sum(u * linear) / linear.sum()
        length = np.sqrt(12.0 * np.sum((u - mean) ** 2 * linear) / linear.sum())
        assert length == pytest.approx(RATE * EXPOSURE_S[severity] * FOCAL, rel=0.15)
        assert abs(mean) < 0.5  # centred on the frame's time


def test_lines_along_the_motion_stay_sharp_and_a_still_camera_does_not_blur() -> None:
    image = flat(60)
    image[HEIGHT // 2 :] = 180
    rows = degraded(turning(image, frames=20), "motion_blur:5@0-1", 5)[:, WIDTH // 2 - 8 : WIDTH // 2 + 8].mean(axis=1)
    assert rows[HEIGHT // 2 + 2] - rows[HEIGHT // 2 - 3] > 115.0
    still = degraded(turning(image, frames=20, rate=0.0), "motion_blur:5@0-1", 5)
    np.testing.assert_allclose(still, image, atol=12)


def test_the_direction_is_that_of_the_gyro() -> None:
    """Turning about y moves the scene along x, about the optical axis along circles: the middle stays sharp."""
    from dataclasses import replace

    from navcore.imu import ImuSamples

    grid = flat(60)
    grid[:, ::16] = 220
    sequence = turning(grid, frames=20)
    rolling = np.tile([0.0, 0.0, 3.0], (len(sequence.imu), 1))
    sequence = replace(sequence, imu=ImuSamples(sequence.imu.t_ns, rolling, sequence.imu.accel))
    seen = degraded(sequence, "motion_blur:5@0-1", 5).astype(float)
    middle = seen[HEIGHT // 2 - 4 : HEIGHT // 2 + 4].std(axis=1).mean()
    edge = np.concatenate([seen[:4], seen[-4:]]).std(axis=1).mean()
    assert middle > 1.3 * edge
