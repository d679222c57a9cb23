"""Two cameras before textured walls: the same feature has the same number in both, and lies where geometry puts it."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from navcore.calibration import CameraMount
from navcore.tracker import Numbers, StereoMatcher, Tracker
from tests.navcore.test_tracker import CAMERA, shift, texture, turn, warped

BASELINE = 0.11  # m, along the first camera's x


def mount(R_BC=None, x=0.0):
    T_BC = np.eye(4)
    T_BC[:3, :3] = np.eye(3) if R_BC is None else R_BC
    T_BC[0, 3] = x
    return CameraMount(CAMERA, T_BC, 0.0)


class Pair:
    """Two cameras and what follows their features."""

    def __init__(self, second):
        numbers = Numbers()
        self.one, self.other = (Tracker(CAMERA, numbers=numbers) for _ in range(2))
        self.matcher = StereoMatcher(mount(), self.one, second, self.other)

    def see(self, left, right, R_C1C0=None):
        """Images of one time; returns rows of both trackers that are the same features."""
        self.one.track(left, R_C1C0)
        if self.other.follow(right, R_C1C0):
            self.matcher.match()
        return np.intersect1d(self.one.ids, self.other.ids, assume_unique=True, return_indices=True)[1:]


def disparity(depth):
    """Homography from the left image to the right one of a wall at `depth` m across the view."""
    return shift(-458.0 * BASELINE / depth, 0.0)


@pytest.mark.parametrize("depth", [1.0, 3.0, 50.0])
def test_features_are_found_in_the_other_camera_where_geometry_puts_them(depth):
    left = texture(20)
    pair = Pair(mount(x=BASELINE))
    for _ in range(3):  # the first images teach how far away things are
        a, b = pair.see(left, warped(left, disparity(depth), noise=2.0))
    assert len(a) > 0.8 * (pair.one.uv[:, 0] > 458.0 * BASELINE / depth + 10.0).sum()
    off = pair.other.uv[b] - pair.one.uv[a] - [-458.0 * BASELINE / depth, 0.0]
    assert np.median(np.linalg.norm(off, axis=1)) < 0.15
    assert np.quantile(np.linalg.norm(off, axis=1), 0.95) < 0.5


def test_matches_last_while_the_cameras_move_and_new_features_are_matched_too():
    pair, wall = Pair(mount(x=BASELINE)), texture(21, margin=200)
    for k in range(8):
        left = np.ascontiguousarray(wall[200:680, 20 + 25 * k : 772 + 25 * k])
        a, b = pair.see(left, warped(left, disparity(2.0), noise=2.0, seed=k))
        off = pair.other.uv[b] - pair.one.uv[a] - [-458.0 * BASELINE / 2.0, 0.0]
        assert len(a) > 100
        assert np.median(np.linalg.norm(off, axis=1)) < 0.3
    assert (pair.one.ids[a] > 150).sum() > 20  # not only those of the first image


def test_a_camera_that_is_turned_a_little_against_its_calibration_still_matches():
    """0.2 degrees are 1.6 px."""
    R, H = turn(np.array([np.radians(0.2), 0.0, 0.0]))
    left = texture(22)
    a, _ = Pair(mount(x=BASELINE)).see(left, warped(left, H @ disparity(2.0)))
    assert len(a) > 100
    assert not np.allclose(R, np.eye(3))


def test_a_feature_off_its_epipolar_line_is_no_match():
    """Two degrees are 16 px: not a calibration that is a little off."""
    _, H = turn(np.array([np.radians(2.0), 0.0, 0.0]))
    left = texture(23)
    a, _ = Pair(mount(x=BASELINE)).see(left, warped(left, H @ disparity(2.0)))
    assert len(a) < 8


def test_cameras_that_turn_their_backs_to_each_other_share_nothing():
    back = Rotation.from_rotvec([0.0, np.pi, 0.0]).as_matrix()
    pair = Pair(mount(back, BASELINE))
    a, _ = pair.see(texture(24), texture(24))
    assert len(a) == 0
    pair.other.begin(pair.other.grid.counts(pair.other.uv) == 0)
    assert len(pair.other.ids) > 100
    assert not np.isin(pair.other.ids, pair.one.ids).any()


def test_an_exposure_of_its_own_costs_no_matches():
    left = texture(25)
    right = np.clip(0.4 * warped(left, disparity(2.0)) + 20.0, 0, 255).astype(np.uint8)
    a, _ = Pair(mount(x=BASELINE)).see(left, right)
    assert len(a) > 100


def test_what_the_second_camera_followed_for_itself_gives_way_to_a_match():
    left = texture(26)
    pair = Pair(mount(x=BASELINE))
    pair.other.track(warped(left, disparity(2.0)), None)
    own = pair.other.ids
    a, _ = pair.see(left, warped(left, disparity(2.0)))
    assert len(a) > 100
    apart = np.linalg.norm(pair.other.uv[:, None] - pair.other.uv, axis=2) + 1e3 * np.eye(len(pair.other.uv))
    assert apart[np.isin(pair.other.ids, own)].min(initial=1e3) > 5.0
