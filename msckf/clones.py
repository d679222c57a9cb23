"""Poses of the body at past frames."""

from dataclasses import dataclass

import numpy as np

from navcore.arrays import Rotations, Stamps, Vectors


@dataclass
class Clones:
    """Poses of the body at past frames, oldest first, and where each was first estimated.

    Attributes:
        t_ns: (K,) camera time.
        R_WB, p_WB: (K, 3, 3), (K, 3) current estimates.
        R_first, p_first: the same when the clone was made; linearisation points under FEJ.
    """

    t_ns: Stamps
    R_WB: Rotations
    p_WB: Vectors
    R_first: Rotations
    p_first: Vectors

    @staticmethod
    def none() -> "Clones":
        """No clones."""
        return Clones(
            np.zeros(0, dtype=np.int64),
            np.zeros((0, 3, 3)),
            np.zeros((0, 3)),
            np.zeros((0, 3, 3)),
            np.zeros((0, 3)),
        )

    def __len__(self) -> int:
        return len(self.t_ns)

    def with_one(self, t_ns: int, R_WB: Rotations, p_WB: Vectors, R_first: Rotations, p_first: Vectors) -> "Clones":
        """The clones and a new one."""
        return Clones(
            np.append(self.t_ns, np.int64(t_ns)),
            np.concatenate([self.R_WB, R_WB[None]]),
            np.concatenate([self.p_WB, p_WB[None]]),
            np.concatenate([self.R_first, R_first[None]]),
            np.concatenate([self.p_first, p_first[None]]),
        )

    def without(self, k: int) -> "Clones":
        """The clones but for one."""
        keep = np.arange(len(self)) != k
        return Clones(self.t_ns[keep], self.R_WB[keep], self.p_WB[keep], self.R_first[keep], self.p_first[keep])
