"""The tracker on pictures whose motion is known: warped textures, followed to a fraction of a pixel."""

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from navcore.camera import PinholeRadtan
from navcore.tracker import ImageQuality, Tracker, TrackerConfig, two_point_inliers

CAMERA = PinholeRadtan(752, 480, 458.0, 457.0, 375.5, 239.5)  # no distortion: a rotation is a homography
K = np.array([[458.0, 0.0, 375.5], [0.0, 457.0, 239.5], [0.0, 0.0, 1.0]])


def texture(seed=0, size=(480, 752), margin=0):
    """Random blobs with corners of many sizes."""
    rng = np.random.default_rng(seed)
    shape = (size[0] + 2 * margin, size[1] + 2 * margin)
    image = sum(s * cv2.GaussianBlur(rng.standard_normal(shape), (0, 0), s) for s in (1.5, 3.0, 6.0))
    return np.clip(128.0 + 45.0 * image / image.std(), 0, 255).astype(np.uint8)


def warped(image, H, noise=0.0, seed=0):
    """The image moved by a homography of pixels (new = H old), filled by reflection at the edges."""
    moved = cv2.warpPerspective(image, H, (752, 480), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
    noisy = moved + noise * np.random.default_rng(seed).standard_normal(moved.shape)
    return np.clip(noisy, 0, 255).astype(np.uint8)


def apply(H, uv):
    moved = np.column_stack([uv, np.ones(len(uv))]) @ H.T
    return moved[:, :2] / moved[:, 2:]


def shift(du, dv):
    return np.array([[1.0, 0.0, du], [0.0, 1.0, dv], [0.0, 0.0, 1.0]])


def turn(rotvec):
    """Homography of a camera that turns by R_C1C0."""
    R = Rotation.from_rotvec(rotvec).as_matrix()
    return R, K @ R @ np.linalg.inv(K)


def followed(before, after):
    """Rows of features that both tracks hold."""
    return np.intersect1d(before.ids, after.ids, return_indices=True)[1:]


@pytest.mark.parametrize("motion", [(3.3, -1.7), (-12.4, 8.6), (0.0, 0.0)])
def test_features_follow_a_shift(motion):
    image, tracker, H = texture(), Tracker(CAMERA), shift(*motion)
    first = tracker.track(image, None)
    second = tracker.track(warped(image, H, noise=2.0), None)
    a, b = followed(first, second)
    assert len(a) > 0.8 * len(first)
    off = np.linalg.norm(second.uv[b] - apply(H, first.uv[a]), axis=1)
    assert np.median(off) < 0.1
    assert np.quantile(off, 0.95) < 0.2


@pytest.mark.parametrize("rotvec", [(0.0, 0.0, 0.08), (0.02, -0.03, 0.05), (0.0, 0.12, 0.0)])
def test_the_gyros_rotation_leads_to_features_that_moved_far(rotvec):
    """With the rotation known, even 50 px between images are followed; nothing but the rotation moved."""
    R, H = turn(np.array(rotvec))
    image, tracker = texture(1), Tracker(CAMERA)
    first = tracker.track(image, None)
    second = tracker.track(warped(image, H, noise=2.0), R)
    a, b = followed(first, second)
    expected = apply(H, first.uv[a])
    assert len(a) > 0.7 * CAMERA.inside(apply(H, first.uv), 20.0).sum()
    off = np.linalg.norm(second.uv[b] - expected, axis=1)
    assert np.median(off) < 0.2
    assert np.quantile(off, 0.95) < 0.5
    assert np.linalg.norm(expected - first.uv[a], axis=1).max() > 15.0


@pytest.mark.parametrize(("R_C1C0", "skipped"), [(None, 0), (np.eye(3), 1), (np.eye(3), 0)])
def test_a_jump_that_no_rotation_explains_is_followed(R_C1C0, skipped):
    """Without a gyro, after an image that was missing, and where the gyro says that nothing moved."""
    image, tracker, H = texture(), Tracker(CAMERA), shift(22.0, -12.0)
    first = tracker.track(image, None)
    for _ in range(skipped):
        tracker.skip()
    second = tracker.track(warped(image, H, noise=2.0), R_C1C0)
    a, b = followed(first, second)
    assert len(a) > 0.7 * len(first)
    assert np.median(np.linalg.norm(second.uv[b] - apply(H, first.uv[a]), axis=1)) < 0.2


def test_a_long_walk_drifts_little():
    """Fifteen images, 2.5 px apart: each feature stays on its corner."""
    image, tracker = texture(2), Tracker(CAMERA)
    first = tracker.track(image, None)
    for k in range(1, 16):
        H = shift(2.2 * k, -1.2 * k)
        last = tracker.track(warped(image, H, noise=2.0, seed=k), None)
    a, b = followed(first, last)
    assert len(a) > 0.5 * len(first)
    off = np.linalg.norm(last.uv[b] - apply(H, first.uv[a]), axis=1)
    assert np.median(off) < 0.3


def test_features_are_spread_and_apart():
    config = TrackerConfig()
    tracks = Tracker(CAMERA).track(texture(), None)
    assert 0.9 * config.max_features < len(tracks) <= config.max_features
    counts = np.histogram2d(*tracks.uv.T, bins=(8, 5), range=((0, 752), (0, 480)))[0]
    assert np.mean(counts >= 2) > 0.9
    apart = np.linalg.norm(tracks.uv[:, None] - tracks.uv, axis=2) + 1e3 * np.eye(len(tracks))
    assert apart.min() > 0.9 * config.min_distance
    assert CAMERA.inside(tracks.uv, config.border).all()


def test_ids_are_never_reused_and_lost_features_are_replaced():
    tracker, seen, alive = Tracker(CAMERA), set(), set()
    image = texture(3, margin=200)
    for k in range(12):
        tracks = tracker.track(np.ascontiguousarray(image[200:680, 20 + 30 * k : 772 + 30 * k]), None)
        now = set(tracks.ids.tolist())
        assert len(now) == len(tracks)
        assert not (now - alive) & seen  # what is new was never there
        seen |= now
        alive = now
        assert len(tracks) > 120
    assert len(seen) > 200


def test_the_same_images_give_the_same_tracks():
    images = [warped(texture(4), shift(3.0 * k, k), noise=3.0, seed=k) for k in range(5)]
    one, two = ([tracker.track(image, None) for image in images] for tracker in (Tracker(CAMERA), Tracker(CAMERA)))
    for a, b in zip(one, two, strict=True):
        np.testing.assert_array_equal(a.ids, b.ids)
        np.testing.assert_array_equal(a.uv, b.uv)


@pytest.mark.parametrize(
    ("image", "fault"),
    [
        (np.full((480, 752), 2, dtype=np.uint8), "image dark"),
        (np.full((480, 752), 255, dtype=np.uint8), "image saturated"),
        (np.full((480, 752), 120, dtype=np.uint8), "image without texture"),
    ],
    ids=["dark", "saturated", "plain"],
)
def test_an_image_that_offers_nothing_is_named_and_ends_all_tracks_only_if_others_follow(image, fault):
    tracker = Tracker(CAMERA)
    first = tracker.track(texture(), None)
    assert tracker.quality.fault is None
    for _ in range(tracker.config.max_skipped):
        assert len(tracker.track(image, None)) == 0
        assert tracker.quality.fault == fault
    again = tracker.track(warped(texture(), shift(4.0, 2.0)), None)
    assert np.isin(first.ids, again.ids).mean() > 0.8
    for _ in range(tracker.config.max_skipped + 1):
        tracker.track(image, None)
    after = tracker.track(texture(), None)
    assert len(after) > 100
    assert after.ids.min() > again.ids.max()


def test_a_fault_that_leaves_something_to_see_ends_no_tracks():
    """Most of the picture is white, and says so; the rest goes on."""
    image, tracker = texture(), Tracker(CAMERA)
    image[:, 250:] = 255
    first = tracker.track(image, None)
    second = tracker.track(image, None)
    assert tracker.quality.fault == "image saturated"
    assert len(first) > 30
    assert np.isin(first.ids, second.ids).mean() > 0.9


@pytest.mark.parametrize(("gain", "offset"), [(0.5, 0.0), (1.0, 60.0), (0.3, 20.0)])
def test_features_stay_where_they_are_when_the_exposure_changes(gain, offset):
    image, tracker, H = texture(7), Tracker(CAMERA), shift(5.0, -3.0)
    first = tracker.track(image, None)
    other = np.clip(gain * warped(image, H) + offset, 0, 255).astype(np.uint8)
    second = tracker.track(other, None)
    a, b = followed(first, second)
    assert len(a) > 0.75 * len(first)
    assert np.median(np.linalg.norm(second.uv[b] - apply(H, first.uv[a]), axis=1)) < 0.15


def test_features_outlast_a_lamp_that_lights_a_part_of_the_picture():
    image, tracker = texture(8), Tracker(CAMERA)
    light = np.linspace(1.0, 0.2, 752)[None, :]
    first = tracker.track(image, None)
    second = tracker.track(np.clip(light * image, 0, 255).astype(np.uint8), None)
    a, b = followed(first, second)
    assert len(a) > 0.6 * len(first)
    assert np.median(np.linalg.norm(second.uv[b] - first.uv[a], axis=1)) < 1.0


def test_a_dark_picture_has_the_same_corners():
    """A fifth of the light: what is a corner does not hang on grey values."""
    image = texture(9)
    bright = Tracker(CAMERA).track(image, None)
    dark = Tracker(CAMERA).track((0.2 * image).astype(np.uint8), None)
    nearest = np.linalg.norm(dark.uv[:, None] - bright.uv, axis=2).min(axis=1)
    assert len(dark) > 0.9 * len(bright)
    assert (nearest < 2.0).mean() > 0.6


def test_one_textured_corner_does_not_take_the_whole_budget():
    image = np.full((480, 752), 100, dtype=np.uint8)
    image[:200, :300] = texture(10)[:200, :300]
    image[300:480, 500:752] = 100 + (texture(11)[300:480, 500:752].astype(int) - 128) // 4
    tracks = Tracker(CAMERA).track(image, None)
    assert (tracks.uv[:, 0] > 490).sum() > 20
    assert Tracker(CAMERA).grid.counts(tracks.uv).max() <= Tracker(CAMERA).grid.share


def test_a_reset_ends_all_features():
    tracker = Tracker(CAMERA)
    first = tracker.track(texture(), None)
    tracker.reset()
    second = tracker.track(texture(), None)
    assert not np.isin(second.ids, first.ids).any()
    np.testing.assert_array_equal(np.sort(second.uv, axis=0), np.sort(first.uv, axis=0))


def test_quality_measures_the_picture():
    tracker = Tracker(CAMERA)
    image = texture()
    tracker.track(image, None)
    assert tracker.quality.mean == pytest.approx(image.mean(), abs=3.0)
    assert tracker.quality.contrast == pytest.approx(image.std(), rel=0.1)
    assert ImageQuality(200.0, 60.0, 0.7).fault == "image saturated"
    assert ImageQuality(8.0, 20.0, 0.0).fault is None  # dark, but with light in it


def spin(angle, u=350.0, v=240.0):
    """Homography of a turn about a pixel."""
    c, s = np.cos(angle), np.sin(angle)
    return shift(u, v) @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ shift(-u, -v)


@pytest.mark.parametrize(("led", "H"), [(True, shift(0.0, -12.0)), (False, spin(0.12))], ids=["led", "alone"])
def test_a_thing_that_moves_by_itself_is_left_out(led, H):
    """A quarter of the picture slides across the motion of the rest; without the gyro it has to spin to be told, since
    one epipolar geometry fits any two shifts."""
    image, patch, tracker = texture(5), texture(6), Tracker(CAMERA)
    before, after = image.copy(), warped(image, shift(5.0, 1.0))
    before[80:400, 200:500] = patch[80:400, 200:500]
    after[80:400, 200:500] = warped(patch, H)[80:400, 200:500]
    first = tracker.track(before, None)
    second = tracker.track(after, np.eye(3) if led else None)
    inside = ((first.uv > [215, 110]) & (first.uv < [485, 385])).all(axis=1)
    outside = ((first.uv < [190, 70]) | (first.uv > [510, 410])).any(axis=1)
    kept = np.isin(first.ids, second.ids)
    assert inside.sum() > 15
    assert kept[inside].mean() < 0.35
    assert kept[outside].mean() > 0.7


def two_views(n=100, outliers=30, seed=0, translation=(0.3, -0.1, 0.1), noise=0.3):
    """Unit bearings of n points in two views, the first turned into the second's frame; which are outliers."""
    rng = np.random.default_rng(seed)
    points = rng.uniform([-2, -1.5, 3.0], [2, 1.5, 8.0], (n, 3))
    rotated, bearings = points, points - np.array(translation)
    bearings = bearings / bearings[:, 2:] + noise / 458.0 * np.column_stack([rng.standard_normal((n, 2)), np.zeros(n)])
    wrong = np.arange(n) < outliers
    bearings[wrong, :2] += rng.uniform(0.05, 0.15, (outliers, 2)) * rng.choice([-1.0, 1.0], (outliers, 2))
    unit = [x / np.linalg.norm(x, axis=1, keepdims=True) for x in (rotated, bearings)]
    return *unit, wrong


PAIRS = np.random.default_rng(0).random((40, 2))
THRESHOLD = 1.5 / 458.0


@pytest.mark.parametrize("translation", [(0.3, -0.1, 0.1), (0.0, 0.0, 0.5), (0.4, 0.0, 0.0)])
def test_two_points_and_a_rotation_separate_outliers(translation):
    caught, kept = [], []
    for seed in range(10):
        rotated, bearings, wrong = two_views(seed=seed, translation=translation)
        inlier = two_point_inliers(rotated, bearings, THRESHOLD, PAIRS)
        caught.append((~inlier[wrong]).mean())
        kept.append(inlier[~wrong].mean())
    assert np.mean(kept) > 0.97
    assert np.mean(caught) > 0.85  # one that slid along its epipolar plane cannot be told


def test_where_nothing_moved_what_moved_is_the_outlier():
    rotated, bearings, wrong = two_views(outliers=5, translation=(0.0, 0.0, 0.0), noise=0.2)
    np.testing.assert_array_equal(two_point_inliers(rotated, bearings, THRESHOLD, PAIRS), ~wrong)


def test_too_few_to_judge_are_kept():
    rotated, bearings, _ = two_views(n=2, outliers=0)
    assert two_point_inliers(rotated, bearings, THRESHOLD, PAIRS).all()
    assert two_point_inliers(rotated[:0], bearings[:0], THRESHOLD, PAIRS).shape == (0,)
