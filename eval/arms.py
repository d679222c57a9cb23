"""The arms of a study: what an estimator is told about the biases, all else being equal."""

import hashlib
import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from eval.errors import StudyError
from eval.flights import PointsFlight
from navcore.arrays import Floats
from sim.imu import grade, simulate_imu
from sim.platforms import simulate_motion
from sim.streams import Streams

BASE = "none"
"""The arm that all others are compared with."""


@dataclass(frozen=True)
class Arm:
    """One way to tell, or not to tell.

    Attributes:
        name: for people.
        prior: as `navcore.prior.load_prior` takes it; a file is looked for in the study's folder.
        noise_seed: another draw of IMU, biases and vision over the same flight: it shows what chance does.
    """

    name: str
    prior: str
    noise_seed: int | None = None

    def reseeded(self, source: PointsFlight) -> PointsFlight:
        """The flight as this arm sees it."""
        return replace(source, noise_seed=self.noise_seed) if self.noise_seed is not None else source


def told(platform: str, device: str, joined: bool = True) -> tuple[Arm, ...]:
    """What a study of a simulated platform tells, from nothing to the truth.

    Memory of the device and what motion reveals are arms apart, since the one is no claim for the other.

    Args:
        platform: whose sources of measurements are meant.
        device: file for the prior `constant`.
        joined: also both sources of measurements together, without the device and with it.
    """
    both = f"ipnet+motion:sim-{platform}"
    together = (Arm("ipnet+motion", both), Arm("constant, ipnet+motion", f"constant:{device},{both}"))
    return (
        Arm(BASE, "none"),
        Arm("constant", f"constant:{device}"),
        Arm("ipnet", f"ipnet:sim-{platform}"),
        Arm("motion", f"motion:sim-{platform}"),
        *(together if joined else ()),
        Arm("truth", "truth"),
    )


def write_device(workspace: Path, imu: str, seeds: range) -> str:
    """What other recordings say of the device, for the prior `constant`: mean and spread of first biases.

    The spread is that of the next draw: the sample covariance times 1 + 1/n.

    Args:
        workspace: the study's folder, where the file is put.
        imu: whose grade.
        seeds: of those recordings; none of them may be in the study.

    Returns:
        Name of the file in `workspace`; a hash of its content is part of it.

    Raises:
        StudyError: too few seeds for a covariance of six numbers.
    """
    if len(seeds) < 12:
        raise StudyError(f"a device prior from {len(seeds)} recordings; its covariance needs 12 or more")
    drawn, any_motion = [], simulate_motion("quadrotor", 1.0, seeds[0])
    for seed in seeds:
        _, truth = simulate_imu(any_motion, grade(imu), Streams.of(seed).imu)
        assert truth.b_g is not None and truth.b_a is not None
        drawn.append(np.concatenate([truth.b_g[0], truth.b_a[0]]))
    mean = np.mean(drawn, axis=0)
    covariance = np.cov(np.array(drawn).T) * (1.0 + 1.0 / len(drawn))
    return write_constant(workspace, mean, covariance)


def write_constant(workspace: Path, mean: Floats, covariance: Floats) -> str:
    """A file for the prior `constant`: mean (6,) and covariance (6, 6) of b_g, b_a; returns its name."""
    content = {"b_g": mean[:3].tolist(), "b_a": mean[3:].tolist(), "covariance": covariance.tolist()}
    text = json.dumps(content, indent=1)
    name = f"device-{hashlib.sha256(text.encode()).hexdigest()[:8]}.json"
    try:
        workspace.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StudyError(f"{workspace} cannot be the folder of a study: {error.strerror}") from error
    partial = workspace / f".{name}.partial"
    partial.write_text(text)
    partial.replace(workspace / name)
    return name
