"""Frames become observations: keys that never clash, rotations that reach back over skipped images."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from msckf.frontend import Frontend
from msckf.views import Rig
from navcore.errors import DataError
from navcore.odometry import SKIPPED
from navcore.sequence import Frame, ImageArray, Tracks
from navcore.tracker import Tracker, TrackerConfig
from tests.msckf.scenes import EQUIDISTANT, RADTAN, mount

TWO = Rig((mount(RADTAN), mount(EQUIDISTANT)))


class Broken:
    """An image that cannot be had."""

    def load(self):
        raise DataError("data/7.png: corrupt image")


def tracks(ids):
    return Tracks(np.array(ids), 100.0 + np.arange(2.0 * len(ids)).reshape(-1, 2))


def test_tracks_pass_through_with_one_number_for_each_feature_of_each_camera():
    front = Frontend(TWO, TrackerConfig())
    seen = front.observe(Frame(0, tracks={0: tracks([3, 8]), 1: tracks([3, 9, 10])}), np.eye(3), {})
    assert seen.cameras.tolist() == [0, 0, 1, 1, 1]
    assert len(set(seen.keys.tolist())) == 5
    again = front.observe(Frame(1, tracks={0: tracks([8]), 1: tracks([10])}), np.eye(3), {})
    assert again.keys.tolist() == [seen.keys[1], seen.keys[4]]
    np.testing.assert_array_equal(seen.uv[2:], tracks([3, 9, 10]).uv)
    np.testing.assert_allclose(seen.bearings[:2], RADTAN.unproject(seen.uv[:2]))
    np.testing.assert_allclose(seen.bearings[2:], EQUIDISTANT.unproject(seen.uv[2:]))


def test_rows_keep_everything_together():
    seen = Frontend(TWO, TrackerConfig()).observe(Frame(0, tracks={0: tracks([3, 8]), 1: tracks([3])}), None, {})
    some = seen.rows(np.array([False, True, True]))
    assert some.keys.tolist() == seen.keys[1:].tolist()
    np.testing.assert_array_equal(some.uv, seen.uv[1:])
    np.testing.assert_array_equal(some.bearings, seen.bearings[1:])
    assert len(some) == 2


def test_a_camera_without_a_usable_image_costs_its_own_features_only():
    front = Frontend(TWO, TrackerConfig())
    seen = front.observe(Frame(0, images={1: Broken()}, tracks={0: tracks([1, 2])}), np.eye(3), {})
    assert seen.cameras.tolist() == [0, 0]
    assert seen.faults == (f"{SKIPPED}: camera 1: data/7.png: corrupt image",)
    assert front.observe(Frame(1, tracks={0: tracks([1])}), None, {}).faults == (f"{SKIPPED}: camera 1: no image",)


@pytest.mark.parametrize(
    "image", [np.zeros((480, 751), np.uint8), np.zeros((480, 752), np.uint16), np.zeros((4, 4, 3), np.uint8)]
)
def test_an_image_of_the_wrong_size_or_kind_is_refused_with_what_was_expected(image):
    seen = Frontend(Rig((mount(RADTAN),)), TrackerConfig()).observe(Frame(0, {0: ImageArray(image)}), None, {})
    assert len(seen) == 0
    assert "expected 752x480 uint8" in seen.faults[0]
    assert str(image.dtype) in seen.faults[0]


def test_the_rotation_reaches_back_to_the_last_image_that_was_seen(monkeypatch):
    heard = []
    real = Tracker.track
    monkeypatch.setattr(Tracker, "track", lambda self, image, R: (heard.append(R), real(self, image, R))[1])
    rig = Rig((mount(RADTAN),))
    image = ImageArray(np.random.default_rng(0).integers(0, 255, (480, 752)).astype(np.uint8))
    front, stages = Frontend(rig, TrackerConfig()), {}
    turns = [Rotation.from_rotvec([0.01 * k, 0.02, -0.01]).as_matrix() for k in range(1, 5)]
    R_BC = rig.R_BC[0]
    for frame, turn in zip([{0: image}, {}, {0: Broken()}, {0: image}], turns, strict=True):
        front.observe(Frame(0, frame), turn, stages)
    assert len(heard) == 2
    np.testing.assert_allclose(heard[1], R_BC.T @ turns[3] @ turns[2] @ turns[1] @ R_BC, atol=1e-12)
    assert set(stages) == {"decode", "track"}
    front.observe(Frame(0, {}), None, stages)  # a rotation that nobody knows
    front.observe(Frame(0, {0: image}), turns[0], stages)
    assert heard[2] is None
    front.observe(Frame(0, {0: image}), turns[1], stages)
    np.testing.assert_allclose(heard[3], R_BC.T @ turns[1] @ R_BC, atol=1e-12)
