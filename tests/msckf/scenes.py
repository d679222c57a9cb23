"""Small scenes for tests: poses on an arc, features before them, and starting states."""

import numpy as np
from scipy.spatial.transform import Rotation

from msckf.views import Rig, Views
from navcore.calibration import CameraMount
from navcore.camera import Camera, PinholeEquidistant, PinholeRadtan
from navcore.odometry import State

RADTAN = PinholeRadtan(752, 480, 458.0, 457.0, 367.0, 248.0, (-0.28, 0.07, 2e-4, 2e-5))
EQUIDISTANT = PinholeEquidistant(512, 512, 190.0, 191.0, 255.0, 257.0, (0.0035, 7e-4, -2e-3, 2e-4))
SIGMAS = np.repeat([0.02, 0.05, 0.1, 1e-3, 0.02], 3)


def mount(camera: Camera = RADTAN, dt_cam_imu: float = 0.0) -> CameraMount:
    """A camera that looks along B's x, a little turned and moved."""
    T_BC = np.eye(4)
    T_BC[:3, :3] = [[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]
    T_BC[:3, :3] = T_BC[:3, :3] @ Rotation.from_rotvec([0.05, -0.1, 0.02]).as_matrix()
    T_BC[:3, 3] = [0.06, -0.02, 0.015]
    return CameraMount(camera, T_BC, dt_cam_imu)


def poses(K=8, seed=0, step=0.15):
    """R_WB (K, 3, 3) and p_WB (K, 3) of a body that moves sideways past what it looks at."""
    rng = np.random.default_rng(seed)
    turn = Rotation.from_rotvec(0.05 * rng.standard_normal((K, 3)) + [0.0, 0.0, 0.4])
    along = step * np.arange(K)[:, None] * [-0.4, 0.9, 0.1]
    return turn.as_matrix(), along + 0.03 * rng.standard_normal((K, 3)) + [1.0, -2.0, 1.5]


def features(F, R_WB, p_WB, seed=0, near=2.0, far=6.0):
    """(F, 3) points in W that the middle pose sees in the middle of its image."""
    rng = np.random.default_rng(seed)
    k = len(R_WB) // 2
    depth = rng.uniform(near, far, F)
    p_BF = depth[:, None] * np.column_stack([np.ones(F), rng.uniform(-0.3, 0.3, (F, 2))])
    return p_WB[k] + p_BF @ R_WB[k].T


def project(mounts, cameras, R_WB, p_WB, p_WF):
    """(F, K, 2) pixels, view by view."""
    uv = np.empty((len(p_WF), len(R_WB), 2))
    for f, camera in enumerate(cameras):
        m = mounts[camera]
        for k in range(len(R_WB)):
            p_BF = R_WB[k].T @ (p_WF[f] - p_WB[k])
            uv[f, k] = m.camera.project(m.R_BC.T @ (p_BF - m.p_BC))
    return uv


def views(F=12, K=8, mounts=None, seed=0, noise=0.0, share_seen=1.0, **depths):
    """Views of a scene with R_WB, p_WB and p_WF that made it."""
    mounts = mounts or (mount(),)
    rng = np.random.default_rng(seed + 100)
    R_WB, p_WB = poses(K, seed)
    p_WF = features(F, R_WB, p_WB, seed, **depths)
    cameras = np.arange(F) % len(mounts)
    uv = project(mounts, cameras, R_WB, p_WB, p_WF) + noise * rng.standard_normal((F, K, 2))
    seen = rng.random((F, K)) < share_seen
    seen[:, :4] = True
    return Views(Rig(mounts), cameras, uv, seen), R_WB, p_WB, p_WF


def start_state(seed=0, sigmas=SIGMAS):
    """A state with a full random covariance of about these standard deviations."""
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((15, 40))
    correlation = A @ A.T / 40.0
    return State(
        Rotation.random(rng=rng).as_matrix(),
        rng.standard_normal(3),
        rng.standard_normal(3),
        1e-2 * rng.standard_normal(3),
        0.1 * rng.standard_normal(3),
        correlation * np.outer(sigmas, sigmas),
    )
