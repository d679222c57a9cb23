"""Linear least squares over a chain of nodes with a border that all of them share, in information form."""

from dataclasses import dataclass

import numpy as np

from navcore.arrays import Floats


@dataclass
class Chain:
    """Normal equations of N + 1 nodes of size n and a border of size m.

    Attributes:
        D: (N + 1, n, n) information of each node.
        E: (N, n, n) between a node (rows) and the next (columns).
        F: (N + 1, n, m) between a node and the border.
        G: (m, m) of the border.
        h: (N + 1, n) and k: (m,) right-hand sides.
    """

    D: Floats
    E: Floats
    F: Floats
    G: Floats
    h: Floats
    k: Floats

    @staticmethod
    def empty(nodes: int, size: int, border: int) -> "Chain":
        """Nothing known."""
        return Chain(
            np.zeros((nodes, size, size)),
            np.zeros((nodes - 1, size, size)),
            np.zeros((nodes, size, border)),
            np.zeros((border, border)),
            np.zeros((nodes, size)),
            np.zeros(border),
        )

    def solve(self) -> tuple[Floats, Floats, Floats]:
        """The nodes (N + 1, n), the border (m,), and the covariance (n, n) of the last node, where elimination ends."""
        n = self.D.shape[1]
        last = len(self.D) - 1
        D, F, h = self.D.copy(), self.F.copy(), self.h.copy()
        G, k = self.G.copy(), self.k.copy()
        kept: list[Floats] = []
        for i in range(last):
            S = np.linalg.solve(D[i], np.hstack([self.E[i], F[i], h[i][:, None]]))
            kept.append(S)
            D[i + 1] -= self.E[i].T @ S[:, :n]
            F[i + 1] -= self.E[i].T @ S[:, n:-1]
            h[i + 1] -= self.E[i].T @ S[:, -1]
            G -= F[i].T @ S[:, n:-1]
            k -= F[i].T @ S[:, -1]
        covariance = np.linalg.inv(np.block([[D[last], F[last]], [F[last].T, G]]))
        solution = covariance @ np.concatenate([h[last], k])
        x, border = np.zeros_like(h), solution[n:]
        x[last] = solution[:n]
        for i, S in reversed(list(enumerate(kept))):
            x[i] = S[:, -1] - S[:, :n] @ x[i + 1] - S[:, n:-1] @ border
        return x, border, 0.5 * (covariance + covariance.T)[:n, :n]
