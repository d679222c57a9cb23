"""Things in front of the cameras: how much they cover, and that all cameras see the same ones."""

import numpy as np
import pytest

from navcore.sequence import Sequence
from tests.sim.degrade.recordings import FOCAL, all_degraded, degraded, flat, turning


def covered(frames: range, severity: int, seed: int = 1) -> np.ndarray:
    """(N, height, width): where the scene behind makes no difference."""
    spec = f"moving_objects:{severity}@0-10"
    black, white = (all_degraded(turning(flat(g), 200, cameras=1), spec, frames, seed=seed) for g in (0, 255))
    return np.abs(np.array(white, dtype=float) - np.array(black)) < 60.0


def opaque(sequence: Sequence, severity: int, k: int, seed: int, camera: int = 0) -> np.ndarray:
    return degraded(sequence, f"moving_objects:{severity}@0-{len(sequence.frames) / 20}", k, camera, seed).astype(float)


def test_coverage_goes_from_five_to_ninety_per_cent() -> None:
    shares = [float(np.mean([covered(range(0, 200, 25), s, seed).mean() for seed in (1, 2, 3)])) for s in range(1, 6)]
    np.testing.assert_allclose(shares, [0.05, 0.13, 0.25, 0.45, 0.9], atol=0.05)


def test_they_move_on_their_own() -> None:
    still = turning(flat(128), frames=60, cameras=1, rate=0.0)
    one, other = (opaque(still, 3, k, 1) for k in (10, 12))
    assert 0.05 < (np.abs(one - other) > 20.0).mean() < 0.9
    again = opaque(still, 3, 10, 1)
    np.testing.assert_array_equal(one, again)


def test_both_cameras_see_them_where_their_distance_puts_them() -> None:
    """A camera 0.1 m to the side sees things at 1.2 to 4 m moved by focal x 0.1 / distance: 4 to 13 px here."""
    sequence = turning(flat(128), frames=60, cameras=2, rate=0.0)
    shifts = []
    for seed in range(8):
        left, right = (opaque(sequence, 5, 5, seed, c)[16:-16] for c in (0, 1))
        costs = [np.abs(left[:, 24:] - right[:, 24 - d : right.shape[1] - d]).mean() for d in range(20)]
        shifts.append(int(np.argmin(costs)))
    nearest, farthest = FOCAL * 0.1 / 1.2, FOCAL * 0.1 / 4.0
    assert all(farthest - 1.5 <= s <= nearest + 1.5 for s in shifts)
    assert len(set(shifts)) > 1


def test_the_scene_between_them_is_left_alone() -> None:
    image = turning(frames=60, cameras=1)
    seen, clean = opaque(image, 1, 7, 1), image.frames[7].images[0].load().astype(float)
    free = ~covered(range(7, 8), 1)[0]
    assert free.mean() > 0.5
    assert np.abs(seen - clean)[free].mean() == pytest.approx(0.0, abs=1.5)
