"""Features that are part of the state: inverse depth, anchored in a clone (docs/filter.md, section 4.8)."""

from dataclasses import dataclass

import numpy as np

from msckf.bearings import across_and_along
from navcore.arrays import Floats, Mask, Rotations, Stamps, Vectors


@dataclass
class Landmarks:
    """Points in the body frame A of a clone each, p_AF = origin + frame (alpha, beta, 1) / rho.

    Attributes:
        keys: (L,) feature numbers.
        anchors: (L,) stamps of the clones.
        origins: (L, 3) m, where the camera sat that saw the feature from there; a constant.
        frames: (L, 3, 3) rotations to A whose last column points at the feature, or did; constants.
        y: (L, 3) alpha, beta, and rho in 1/m: the current estimates.
    """

    keys: Stamps
    anchors: Stamps
    origins: Vectors
    frames: Rotations
    y: Vectors

    @staticmethod
    def none() -> "Landmarks":
        """No landmarks."""
        none = np.zeros(0, dtype=np.int64)
        return Landmarks(none, none, np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros((0, 3)))

    @staticmethod
    def at(keys: Stamps, anchors: Stamps, origins: Vectors, p_AF: Vectors) -> "Landmarks":
        """Landmarks at these points (L, 3) of their anchors' frames, alpha and beta zero."""
        ray = p_AF - origins
        distance = np.linalg.norm(ray, axis=1)
        y = np.zeros((len(keys), 3))
        y[:, 2] = 1.0 / distance
        return Landmarks(keys, anchors, origins, across_and_along(ray / distance[:, None]), y)

    def __len__(self) -> int:
        return len(self.keys)

    @property
    def p_AF(self) -> Vectors:
        """(L, 3) m, in the body frame of the anchor."""
        return self.origins + self._direction() / self.y[:, 2:]

    @property
    def by_y(self) -> Floats:
        """(L, 3, 3) derivative of `p_AF` by `y`."""
        rho = self.y[:, 2:]
        return np.concatenate([self.frames[..., :2], (-self._direction() / rho)[..., None]], axis=-1) / rho[..., None]

    def _direction(self) -> Vectors:
        return self.frames[..., 2] + (self.frames[..., :2] @ self.y[:, :2, None])[..., 0]

    def rows(self, mask: Mask) -> "Landmarks":
        """Only some of them."""
        return Landmarks(self.keys[mask], self.anchors[mask], self.origins[mask], self.frames[mask], self.y[mask])

    def and_others(self, others: "Landmarks") -> "Landmarks":
        """These, then the others."""
        return Landmarks(
            np.concatenate([self.keys, others.keys]),
            np.concatenate([self.anchors, others.anchors]),
            np.concatenate([self.origins, others.origins]),
            np.concatenate([self.frames, others.frames]),
            np.concatenate([self.y, others.y]),
        )

    def replaced(self, mask: Mask, others: "Landmarks") -> "Landmarks":
        """These, those of `mask` (L,) by the others in their order."""
        both = self.and_others(others)
        order = np.arange(len(self))
        order[mask] = len(self) + np.arange(len(others))
        return Landmarks(both.keys[order], both.anchors[order], both.origins[order], both.frames[order], both.y[order])
