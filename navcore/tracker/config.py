"""The tracker's settings; units stand in the comments."""

from dataclasses import dataclass


@dataclass(frozen=True)
class TrackerConfig:
    """Settings of the tracker. Grey values are those of an image whose standard deviation is `contrast`."""

    max_features: int = 150  # per image
    refill: int = 10  # features that have to be missing before new ones are looked for
    grid: tuple[int, int] = (8, 5)  # cells across and down, each gets its share of features
    min_distance: int = 15  # px between features when one is added
    strength: float = 1e-3  # of a corner: smaller eigenvalue of the half-size image's structure tensor
    contrast: float = 50.0  # grey values, standard deviation to which images are brought where brightness changes
    max_gain: float = 4.0  # by which an image's contrast may be raised
    brightness_change: float = 1.5  # grey values, mean change of the features' surroundings that calls for it
    clahe_clip: float = 3.0  # contrast limit of the local equalisation that is tried where many features are lost
    window: int = 13  # px, side of the KLT patch
    levels: int = 3  # pyramid levels above the image
    max_residual: float = 40.0  # mean absolute grey difference of a patch to its last one
    border: int = 8  # px, features closer to the edge end
    epipolar_threshold: float = 1.5  # px
    hypotheses: int = 40  # of the two-point RANSAC
    stereo_threshold: float = 2.5  # px from the epipolar line, as far as the calibration knows that
    max_skipped: int = 5  # images in a row that may be missing or useless before features end
