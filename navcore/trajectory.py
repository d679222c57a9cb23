"""A path of the body through the world, with velocity and biases where they are known."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from navcore import so3
from navcore.arrays import Mask, Quaternions, Rotations, Stamps, Vectors, frozen
from navcore.errors import DataError


@dataclass(frozen=True)
class Trajectory:
    """States over time; all arrays are read-only.

    Attributes:
        t_ns: (N,) int64 ns, strictly increasing.
        q_WB: (N, 4) xyzw unit quaternions.
        p_WB: (N, 3) m.
        v_WB: (N, 3) m/s in W, or None.
        b_g: (N, 3) rad/s in B, or None.
        b_a: (N, 3) m/s^2 in B, or None.

    `v_WB`, `b_g` and `b_a` may hold NaN where a source does not know them; poses may not.

    Raises:
        DataError: wrong shapes, poses that are not finite, or stamps that do not increase.
    """

    t_ns: Stamps
    q_WB: Quaternions
    p_WB: Vectors
    v_WB: Vectors | None = None
    b_g: Vectors | None = None
    b_a: Vectors | None = None

    def __post_init__(self) -> None:
        n = len(np.atleast_1d(self.t_ns))
        object.__setattr__(self, "t_ns", frozen("t_ns", self.t_ns, np.int64, (None,)))
        object.__setattr__(self, "q_WB", frozen("q_WB", self.q_WB, np.float64, (n, 4)))
        for name in ("p_WB", "v_WB", "b_g", "b_a"):
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, frozen(name, value, np.float64, (n, 3)))
        if n > 1 and np.any(np.diff(self.t_ns) <= 0):
            k = int(np.argmax(np.diff(self.t_ns) <= 0))
            raise DataError(f"pose stamp {self.t_ns[k + 1]} ns does not follow {self.t_ns[k]} ns")
        norms = np.linalg.norm(self.q_WB, axis=1)
        bad = ~(np.isfinite(self.p_WB).all(axis=1) & (np.abs(norms - 1.0) < 1e-2))
        if bad.any():
            k = int(np.argmax(bad))
            raise DataError(f"pose at {self.t_ns[k]} ns is not one: p {self.p_WB[k]}, q {self.q_WB[k]}")

    def __len__(self) -> int:
        return len(self.t_ns)

    def __getitem__(self, key: slice | Mask | Stamps) -> "Trajectory":
        optional = [None if x is None else x[key] for x in (self.v_WB, self.b_g, self.b_a)]
        return Trajectory(self.t_ns[key], self.q_WB[key], self.p_WB[key], *optional)

    @property
    def R_WB(self) -> Rotations:
        """(N, 3, 3)."""
        return so3.from_quaternion(self.q_WB)

    @property
    def seconds(self) -> Vectors:
        """(N,) seconds since the first pose."""
        return (self.t_ns - self.t_ns[0]) * 1e-9 if len(self) else np.zeros(0)

    @property
    def length(self) -> float:
        """Length of the path [m]."""
        return float(np.linalg.norm(np.diff(self.p_WB, axis=0), axis=1).sum())

    def between(self, start_ns: int, end_ns: int) -> "Trajectory":
        """The states with start_ns <= t_ns < end_ns."""
        first, last = np.searchsorted(self.t_ns, [start_ns, end_ns])
        return self[first:last]

    def covers(self, t_ns: Stamps, max_gap_ns: int = 100_000_000) -> Mask:
        """Whether each stamp (M,) is between two poses at most `max_gap_ns` apart, or within 1 us of one."""
        t_ns = np.asarray(t_ns, dtype=np.int64)
        if len(self) == 0:
            return np.zeros(t_ns.shape, dtype=bool)
        after = np.clip(np.searchsorted(self.t_ns, t_ns), 0, len(self) - 1)
        before = np.clip(after - 1, 0, len(self) - 1)
        on_pose = np.minimum(np.abs(self.t_ns[after] - t_ns), np.abs(self.t_ns[before] - t_ns)) <= 1000
        inside = (self.t_ns[before] <= t_ns) & (t_ns <= self.t_ns[after])
        return np.asarray(on_pose | (inside & (self.t_ns[after] - self.t_ns[before] <= max_gap_ns)))

    def at(self, t_ns: Stamps) -> "Trajectory":
        """The states at stamps (M,): rotation by slerp, the rest linearly; outside the span its ends.

        Use `covers` to know which stamps are inside.
        """
        t_ns = np.asarray(t_ns, dtype=np.int64)
        if len(self) == 0:
            raise DataError("an empty trajectory cannot be interpolated")
        s = np.clip((t_ns - self.t_ns[0]) * 1e-9, 0.0, self.seconds[-1])
        if len(self) == 1:
            q = np.repeat(self.q_WB, len(t_ns), axis=0)
        else:
            q = Slerp(self.seconds, Rotation.from_quat(self.q_WB))(s).as_quat()

        def linear(values: Vectors | None) -> Vectors | None:
            if values is None:
                return None
            return np.stack([np.interp(s, self.seconds, values[:, k]) for k in range(3)], axis=1)

        p = linear(self.p_WB)
        assert p is not None
        return Trajectory(t_ns, q, p, linear(self.v_WB), linear(self.b_g), linear(self.b_a))

    def to_tum(self, path: Path) -> None:
        """Write `t x y z qx qy qz qw`, t in seconds with nine digits; the file appears whole or not."""
        lines = []
        for t, p, q in zip(self.t_ns.tolist(), self.p_WB.tolist(), self.q_WB.tolist(), strict=True):
            numbers = " ".join(f"{x:.9f}" for x in (*p, *q))
            lines.append(f"{t // 1_000_000_000}.{t % 1_000_000_000:09d} {numbers}\n")
        partial = path.with_name(path.name + ".partial")
        partial.write_text("".join(lines))
        partial.replace(path)

    @staticmethod
    def from_tum(path: Path) -> "Trajectory":
        """Read TUM lines; stamps keep every digit that the file gives.

        Raises:
            DataError: the file is missing, or a line is not eight numbers; the message names file and line.
        """
        if not path.is_file():
            raise DataError(f"{path}: no such file; expected a trajectory in TUM format")
        stamps, rows = [], []
        for number, line in enumerate(path.read_text().splitlines(), 1):
            fields = line.split()
            if not fields or fields[0].startswith("#"):
                continue
            try:
                whole, _, fraction = fields[0].partition(".")
                if "e" in fields[0].lower():
                    stamp = round(float(fields[0]) * 1e9)
                else:
                    stamp = int(whole) * 1_000_000_000 + int((fraction + "0" * 9)[:9])
                row = [float(x) for x in fields[1:]]
            except ValueError:
                row = []
            if len(row) != 7:
                raise DataError(f"{path}:{number}: expected 't x y z qx qy qz qw', got {line.strip()!r}")
            stamps.append(stamp)
            rows.append(row)
        values = np.array(rows).reshape(-1, 7)
        try:
            return Trajectory(np.array(stamps, dtype=np.int64), values[:, 3:], values[:, :3])
        except DataError as error:
            raise DataError(f"{path}: {error}") from error
