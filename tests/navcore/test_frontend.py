"""Frames become observations: keys that never clash, rotations that reach back over skipped images."""

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from navcore.calibration import CameraMount
from navcore.camera import PinholeRadtan
from navcore.errors import DataError
from navcore.frontend import Frontend
from navcore.odometry import SKIPPED
from navcore.sequence import Frame, ImageArray, Tracks
from navcore.tracker import Tracker, TrackerConfig
from tests.msckf.scenes import EQUIDISTANT, RADTAN, mount

TWO = (mount(RADTAN), mount(EQUIDISTANT))


class Broken:
    """An image that cannot be had."""

    def load(self):
        raise DataError("data/7.png: corrupt image")


def tracks(ids):
    return Tracks(np.array(ids), 100.0 + np.arange(2.0 * len(ids)).reshape(-1, 2))


def test_tracks_pass_through_and_the_same_number_in_two_cameras_is_the_same_feature():
    front = Frontend(TWO, TrackerConfig())
    seen = front.observe(Frame(0, tracks={0: tracks([3, 8]), 1: tracks([3, 9, 10])}), np.eye(3), {})
    assert seen.cameras.tolist() == [0, 0, 1, 1, 1]
    assert seen.keys.tolist() == [3, 8, 3, 9, 10]
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
    seen = Frontend((mount(RADTAN),), TrackerConfig()).observe(Frame(0, {0: ImageArray(image)}), None, {})
    assert len(seen) == 0
    assert "expected 752x480 uint8" in seen.faults[0]
    assert str(image.dtype) in seen.faults[0]


def test_the_rotation_reaches_back_to_the_last_image_that_was_seen(monkeypatch):
    heard = []
    real = Tracker.follow
    monkeypatch.setattr(Tracker, "follow", lambda self, image, R: (heard.append(R), real(self, image, R))[1])
    one = mount(RADTAN)
    image = ImageArray(np.random.default_rng(0).integers(0, 255, (480, 752)).astype(np.uint8))
    front, stages = Frontend((one,), TrackerConfig()), {}
    turns = [Rotation.from_rotvec([0.01 * k, 0.02, -0.01]).as_matrix() for k in range(1, 5)]
    R_BC = one.R_BC
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


def stereo(shift_px=25, seed=3, missing=()):
    """A frame of two cameras, the second of which sees the picture of the first moved aside."""
    rng = np.random.default_rng(seed)
    wide = cv2.GaussianBlur(rng.standard_normal((480, 852)), (0, 0), 2.0)
    wide = np.clip(128.0 + 45.0 * wide / wide.std(), 0, 255).astype(np.uint8)
    images = {0: wide[:, :752], 1: wide[:, shift_px : 752 + shift_px]}
    return Frame(0, {c: ImageArray(np.ascontiguousarray(x)) for c, x in images.items() if c not in missing})


PLAIN = PinholeRadtan(752, 480, 458.0, 458.0, 375.5, 239.5)


def rig(turned=None):
    """Two cameras beside each other, or one turned."""
    first, second = np.eye(4), np.eye(4)
    second[0, 3] = 0.11
    if turned is not None:
        second[:3, :3] = Rotation.from_rotvec(turned).as_matrix()
    return CameraMount(PLAIN, first, 0.0), CameraMount(PLAIN, second, 0.0)


def shared(seen):
    return np.intersect1d(seen.keys[seen.cameras == 0], seen.keys[seen.cameras == 1])


def test_a_feature_that_two_cameras_see_has_one_key_and_each_camera_its_budget():
    front, config = Frontend(rig(), TrackerConfig()), TrackerConfig()
    seen = front.observe(stereo(), np.eye(3), {})
    assert len(shared(seen)) > 100
    for c in (0, 1):
        keys = seen.keys[seen.cameras == c]
        assert len(set(keys.tolist())) == len(keys) <= 1.1 * config.max_features


def test_cameras_without_a_common_view_follow_features_of_their_own():
    front = Frontend(rig(turned=[0.0, np.pi, 0.0]), TrackerConfig())
    seen = front.observe(stereo(), np.eye(3), {})
    assert len(shared(seen)) == 0
    assert (seen.cameras == 1).sum() > 100


@pytest.mark.parametrize("missing", [0, 1])
def test_one_camera_goes_on_while_the_other_misses_a_frame_and_features_keep_their_keys(missing):
    front = Frontend(rig(), TrackerConfig())
    before = front.observe(stereo(), np.eye(3), {})
    alone = front.observe(stereo(missing=(missing,)), np.eye(3), {})
    assert set(alone.cameras.tolist()) == {1 - missing}
    assert np.isin(shared(before), alone.keys).mean() > 0.9
    after = front.observe(stereo(), np.eye(3), {})
    assert np.isin(shared(before), shared(after)).mean() > 0.8
    assert np.isin(before.keys[before.cameras == missing], after.keys[after.cameras == missing]).mean() > 0.8


def test_a_dark_image_is_a_missing_one_and_is_named():
    front = Frontend(rig(), TrackerConfig())
    before = front.observe(stereo(), np.eye(3), {})
    frame = stereo(missing=(1,))
    black = Frame(1, {**frame.images, 1: ImageArray(np.zeros((480, 752), dtype=np.uint8))})
    dark = front.observe(black, np.eye(3), {})
    assert set(dark.cameras.tolist()) == {0}
    assert dark.faults == ("image dark, camera 1",)
    assert np.isin(shared(before), shared(front.observe(stereo(), np.eye(3), {}))).mean() > 0.8
