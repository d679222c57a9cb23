"""The arms of a study: what an estimator is told about the biases, all else being equal."""

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from eval.errors import StudyError
from eval.flights import PointsFlight
from navcore.arrays import Floats
from sim.imu import grade, simulate_imu
from sim.platforms import simulate_motion
from sim.streams import Streams

BASE = "none"
"""The arm that all others are compared with."""
ESTIMATORS = ("msckf", "factor")
"""Those that the ablation holds against each other."""
WEIGHTS = (1.0, 10.0, 100.0, 1000.0, 10000.0)
"""W of the paper's own weighting, in 1/(rad/s) and 1/(m/s^2), when it is swept."""
PLAIN = (("prior.mode", "plain"),)
"""Settings of the paper's own weighting, for both estimators."""


@dataclass(frozen=True)
class Arm:
    """One way to tell, or not to tell.

    Attributes:
        name: for people.
        prior: as `navcore.prior.load_prior` takes it; a file is looked for in the study's folder.
        noise_seed: another draw of IMU, biases and vision over the same flight: it shows what chance does.
        overrides: settings of the estimator by dotted name.
        estimators: those that can be told so; all by default.
    """

    name: str
    prior: str
    noise_seed: int | None = None
    overrides: tuple[tuple[str, Any], ...] = ()
    estimators: tuple[str, ...] | None = None

    def is_for(self, estimator: str) -> bool:
        """Whether this estimator can be told so."""
        return self.estimators is None or estimator in self.estimators

    def reseeded(self, source: PointsFlight) -> PointsFlight:
        """The flight as this arm sees it."""
        return replace(source, noise_seed=self.noise_seed) if self.noise_seed is not None else source


@dataclass(frozen=True)
class Sources:
    """What can be told of the biases of a recording, as `load_prior` takes it.

    Attributes:
        constant: the device's memory.
        window_mean, ipnet, motion, joined, recursive: what is inferred from the motion; whoever was trained has not
            seen the recording. None where there is no such source.
        truth: whether the true biases are known.
    """

    constant: str | None
    window_mean: str | None
    ipnet: str | None
    motion: str | None
    joined: str | None
    recursive: str | None
    truth: bool = True

    @staticmethod
    def simulated(platform: str, device: str) -> "Sources":
        """Of a simulated platform; `device` is the file for the prior `constant`."""
        name = f"sim-{platform}"
        learned = f"ipnet:{name}", f"motion:{name}", f"ipnet+motion:{name}", f"recursive:{name}"
        return Sources(f"constant:{device}", f"window-mean:{platform}-5", *learned)


Told = Callable[[Sources], tuple[Arm, ...]]
"""The arms of a study, from nothing to the truth.

Memory of the device and what motion reveals are arms apart, since the one is no claim for the other.
"""


def told(sources: Sources) -> tuple[Arm, ...]:
    """The device's memory, each source that infers biases, and the two ends."""
    given = {"constant": sources.constant, "ipnet": sources.ipnet, "motion": sources.motion}
    return _between(*_known(given), truth=sources.truth)


def told_joined(sources: Sources) -> tuple[Arm, ...]:
    """Also both sources that infer biases together, without the device and with it."""
    given = {"constant": sources.constant, "ipnet": sources.ipnet, "motion": sources.motion}
    given["ipnet+motion"] = sources.joined
    if sources.constant and sources.joined:
        given["constant, ipnet+motion"] = f"{sources.constant},{sources.joined}"
    return _between(*_known(given), truth=sources.truth)


def told_all(sources: Sources) -> tuple[Arm, ...]:
    """The ablation's: nothing, memory, every inference, the rivals and the paper's own weighting of the network, the
    truth."""
    plain: list[Arm] = []
    if sources.ipnet is not None:
        figure_2 = (*PLAIN, ("prior.preintegration", "prior"))
        plain.append(Arm("paper-plain", sources.ipnet, overrides=PLAIN))
        plain.append(Arm("paper-plain, figure 2", sources.ipnet, overrides=figure_2, estimators=("factor",)))
    device = {"constant": sources.constant, "window-mean": sources.window_mean}
    inferred = {"ipnet": sources.ipnet, "motion": sources.motion, "ipnet+motion": sources.joined}
    inferred["recursive"] = sources.recursive
    return _between(*_known(device), *plain, *_known(inferred), truth=sources.truth)


def weighed(sources: Sources) -> tuple[Arm, ...]:
    """The paper's own weighting, from light to heavy weights, beside the modelled error of the same source."""
    swept = [
        Arm(f"W = {weight:g}", sources.ipnet, overrides=(*PLAIN, ("prior.weight", weight)))
        for weight in WEIGHTS
        if sources.ipnet is not None
    ]
    return _between(*swept, *_known({"ipnet": sources.ipnet}), truth=False)


def _between(*arms: Arm, truth: bool) -> tuple[Arm, ...]:
    """Those arms between the ends of what can be told."""
    return (Arm(BASE, "none"), *arms, *([Arm("truth", "truth")] if truth else []))


def _known(priors: Mapping[str, str | None]) -> list[Arm]:
    """An arm for each source that there is."""
    return [Arm(name, prior) for name, prior in priors.items() if prior is not None]


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
