"""Small scenes for tests: poses on an arc, features before them, and starting states."""

import numpy as np
from scipy.spatial.transform import Rotation

from msckf.state import FilterState
from msckf.views import Rig, Views
from navcore.calibration import CameraMount
from navcore.camera import Camera, PinholeEquidistant, PinholeRadtan
from navcore.odometry import State

RADTAN = PinholeRadtan(752, 480, 458.0, 457.0, 367.0, 248.0, (-0.28, 0.07, 2e-4, 2e-5))
EQUIDISTANT = PinholeEquidistant(512, 512, 190.0, 191.0, 255.0, 257.0, (0.0035, 7e-4, -2e-3, 2e-4))
SIGMAS = np.repeat([0.02, 0.05, 0.1, 1e-3, 0.02], 3)


def mount(camera: Camera = RADTAN, dt_cam_imu: float = 0.0, right: float = 0.0) -> CameraMount:
    """A camera that looks along B's x, a little turned and moved; `right` m beside the one at 0, and turned further."""
    T_BC = np.eye(4)
    T_BC[:3, :3] = [[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]
    T_BC[:3, :3] = T_BC[:3, :3] @ Rotation.from_rotvec([0.05 + 0.3 * right, -0.1, 0.02 - right]).as_matrix()
    T_BC[:3, 3] = [0.06, -0.02 - right, 0.015]
    return CameraMount(camera, T_BC, dt_cam_imu)


ONE = Rig((mount(),))
STEREO = Rig((mount(), mount(EQUIDISTANT, right=0.12)))


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


def project(rig, R_WB, p_WB, p_WF):
    """(F, K C, 2) pixels, view by view, camera after camera at each pose."""
    uv = np.empty((len(p_WF), len(R_WB), len(rig), 2))
    for f, k, c in np.ndindex(uv.shape[:3]):
        p_BF = R_WB[k].T @ (p_WF[f] - p_WB[k])
        uv[f, k, c] = rig.cameras[c].project(rig.R_BC[c].T @ (p_BF - rig.p_BC[c]))
    return uv.reshape(len(p_WF), -1, 2)


def views(F=12, K=8, rig=ONE, seed=0, noise=0.0, share_seen=1.0, **depths):
    """Views of a scene with R_WB, p_WB and p_WF that made it.

    Every camera sees every feature, at the first four poses and at a share of the others; of three features in
    a row with two cameras, one is seen by both, one by the first only, and one by the second.
    """
    rng = np.random.default_rng(seed + 100)
    R_WB, p_WB = poses(K, seed)
    p_WF = features(F, R_WB, p_WB, seed, **depths)
    uv = project(rig, R_WB, p_WB, p_WF)
    uv = uv + noise * rng.standard_normal(uv.shape)
    seen = (rng.random((F, K)) < share_seen)[..., None] & np.ones(len(rig), dtype=bool)
    seen[:, :4] = True
    for c in range(len(rig)):
        if len(rig) > 1:
            seen[1 + c :: 3, :, np.arange(len(rig)) != c] = False
    return Views(rig, uv, seen.reshape(F, -1)), R_WB, p_WB, p_WF


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


def filter_state(seed=0, rig=ONE, fej=True, sigmas=SIGMAS):
    """The filter's state that begins there."""
    return FilterState(start_state(seed, sigmas), rig, fej=fej)
