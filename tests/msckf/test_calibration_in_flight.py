"""A calibration that is wrong at the start becomes right in flight, and the filter knows how right it is.

Quadrotors with EuRoC-like noise, in points mode; their calibration is off by draws of what the filter takes it to be.
Run with -s to see the figures.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from msckf.config import FilterConfig
from msckf.estimated import Estimated
from msckf.filter import Filter
from navcore import so3
from navcore.odometry import Health, run
from navcore.sequence import Sequence
from sim.points import simulate_points

SIGMAS = {"calibration.position_sigma": 0.01}  # worse than a calibration is: a position takes longer to learn
SWITCHES = {
    "time": {"calibration.time_offset": True, "calibration.extrinsics": False},
    "poses": {"calibration.extrinsics": True},
    "lens": {"calibration.intrinsics": True, "calibration.extrinsics": False},
    "all": {"calibration.time_offset": True, "calibration.extrinsics": True, "calibration.intrinsics": True},
}


def miscalibrated(sequence: Sequence, config: FilterConfig, seed: int) -> tuple[Sequence, float]:
    """The recording with a calibration as wrong as the filter takes it to be, in all that it estimates; and its offset.

    The stamps of the images are shifted by the time offset; the calibration goes on saying that there is none.
    """
    c, rng, estimated = config.calibration, np.random.default_rng([seed, 2]), Estimated.of(config.calibration)
    offset = c.time_sigma * rng.standard_normal() * estimated.time_offset
    mounts = []
    for mount in sequence.calibration.cameras:
        turn, move = c.rotation_sigma * rng.standard_normal(3), c.position_sigma * rng.standard_normal(3)
        lens = np.repeat([c.focal_sigma, c.centre_sigma, c.distortion_sigma], [2, 2, 4]) * rng.standard_normal(8)
        T_BC = mount.T_BC.copy()
        T_BC[:3, :3] = T_BC[:3, :3] @ so3.exp(turn * estimated.extrinsics)
        T_BC[:3, 3] += move * estimated.extrinsics
        camera = mount.camera.with_intrinsics(mount.camera.intrinsics + lens * estimated.intrinsics)
        mounts.append(replace(mount, T_BC=T_BC, camera=camera))
    frames = [replace(frame, t_ns=frame.t_ns - round(1e9 * offset)) for frame in sequence.frames]
    calibration = replace(sequence.calibration, cameras=tuple(mounts))
    return replace(sequence, calibration=calibration, frames=frames), offset


def learned(what: str, seed: int, seconds: float, cameras: int = 1):
    """Of one flight: errors of the calibration (n,) at its end, their covariance, and their sigmas at the start."""
    overrides = SIGMAS | SWITCHES[what] | {"cameras": cameras}
    config = FilterConfig().with_overrides(overrides)
    exact = simulate_points(seed=seed, seconds=seconds, cameras=cameras)
    sequence, offset = miscalibrated(exact, config, seed)
    flown = Filter(sequence.calibration, config)
    result = run(flown, sequence)
    assert all(e.health is not Health.LOST for e in result.estimates)
    state, errors = flown.state, []
    if state.estimated.time_offset:
        errors.append([state.dt_cam_imu - offset])
    for c, mount in enumerate(exact.calibration.cameras):
        if state.estimated.extrinsics:
            errors += [so3.log(mount.R_BC.T @ state.rig.R_BC[c]), state.rig.p_BC[c] - mount.p_BC]
        if state.estimated.intrinsics:
            errors.append(state.rig.cameras[c].intrinsics - mount.camera.intrinsics)
    P = np.array(state.covariance[state.calibration, state.calibration])
    return np.concatenate(errors), P, state.estimated.sigmas(config.calibration, cameras)


@pytest.mark.parametrize(("what", "cameras"), [("time", 1), ("poses", 1), ("lens", 1), ("all", 1), ("poses", 2)])
def test_a_wrong_calibration_becomes_right_within_what_the_filter_claims(what, cameras):
    e, P, sigma_before = learned(what, 1, 15.0, cameras)
    sigma = np.sqrt(np.diagonal(P))
    assert np.abs(e / sigma).max() < 3.5
    assert e @ np.linalg.solve(P, e) < chi2.ppf(0.9995, len(e))
    assert (sigma < 0.7 * sigma_before).all()
    assert np.median(sigma / sigma_before) < 0.25


@pytest.mark.slow
@pytest.mark.parametrize(("what", "cameras"), [("time", 1), ("poses", 1), ("lens", 1), ("all", 1), ("poses", 2)])
def test_the_calibration_is_as_well_known_as_the_filter_claims(what, cameras):
    """NEES over flights."""
    seeds = range(1, 31)
    flights = [learned(what, seed, 15.0, cameras) for seed in seeds]
    n = len(flights[0][0])
    mean = np.mean([e @ np.linalg.solve(P, e) / n for e, P, _ in flights])
    low, high = chi2.ppf([0.001, 0.999], n * len(seeds)) / (n * len(seeds))
    print(f"\n{what}, {cameras} camera(s): NEES {mean:.2f} per degree of freedom, linear {low:.2f} .. {high:.2f}")
    assert low < mean < 1.5 * high
