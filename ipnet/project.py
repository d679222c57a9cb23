"""From recordings to a folder of weights: train each network of a preset, export it, find out how wrong it is."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from ipnet.assessment import calibrate
from ipnet.dataset import Track, open_tracks
from ipnet.errors import ConfigError
from ipnet.export import ONNX, SAFETENSORS, export, load, save
from ipnet.model import IPNet
from ipnet.presets import NetworkConfig, TrainingConfig, preset
from ipnet.recordings import kept_apart
from ipnet.splits import split
from ipnet.training import Devices, begin, train
from ipnet.weights import Card, NetworkCard, find, uncalibrated

EVERY_S = {"short": 5.0, "medium": 5.0, "long": 10.0}
"""Between two statements: the short network's windows do not overlap, the others' by three quarters."""
WEIGHTS_OF = {"medium": "long"}
"""Networks that are not trained, but have another one's weights."""


@dataclass(frozen=True)
class Project:
    """What is to be made.

    Attributes:
        training, validation: folders of recordings.
        split: name of a split whose recordings are taken from `training`; empty for all.
        labels: file of biases, or None.
        preset: its name.
        networks: names, of those in the preset.
        start: weights to begin with, a name or a folder; empty for none.
        any_mount: the IMU may sit in the platform in any way.
        changed: fields of the preset's `TrainingConfig`.
        minutes: for each network, at most; None for no limit.
        seed: of weights and windows.
    """

    training: tuple[Path, ...]
    validation: tuple[Path, ...]
    split: str = ""
    labels: Path | None = None
    preset: str = "default"
    networks: tuple[str, ...] = ("short", "medium", "long")
    start: str = ""
    any_mount: bool = False
    changed: dict[str, Any] = field(default_factory=dict)
    minutes: float | None = None
    seed: int = 1

    @property
    def training_config(self) -> TrainingConfig:
        """How networks are trained."""
        mount: dict[str, Any] = {"mount_deg": 180.0} if self.any_mount else {}
        return replace(preset(self.preset).training, **mount, **self.changed)


def build(project: Project, out: Path, devices: Devices | None = None, progress: bool = True) -> Card:
    """Make the weights, in `out`; what was made before it was interrupted is not made again.

    Raises:
        ConfigError: a name is unknown, or a network lacks the weights to begin with.
        LabelError: recordings cannot be found, or have no known biases, or are too short, or some that were learned
            from, be it by the weights to begin with, validate too.
    """
    config = project.training_config
    training, validation = _tracks(project, out / "recordings")
    before = Card.read(find(project.start)) if project.start else None
    known = (before.training, before.validation) if before is not None else ((), ())
    kept_apart([*known[0], *(t.name for t in training)], (t.name for t in validation))
    cards = {}
    shapes = {name: shape for name, shape in preset(project.preset).networks.items() if name in project.networks}
    for name in sorted(shapes, key=lambda name: name in WEIGHTS_OF):
        shape = shapes[name]
        if project.any_mount:
            shape = replace(shape, mount="any")
        if name in WEIGHTS_OF:
            network = load(out / f"{WEIGHTS_OF[name]}{SAFETENSORS}", shape)
        else:
            network = _trained(name, shape, project, training, validation, out, devices, progress)
        save(network, out / f"{name}{SAFETENSORS}")
        export(network, out / f"{name}{ONNX}")
        every_s = min(EVERY_S[name], shape.samples / shape.rate_hz)
        cards[name] = NetworkCard(shape, every_s, uncalibrated())
    card = Card(
        cards,
        tuple(sorted({*known[0], *(t.name for t in training)})),
        tuple(sorted({*known[1], *(t.name for t in validation)})),
        {"preset": project.preset, "seed": project.seed, "start": project.start, "training": vars(config)},
    )
    card = calibrate(out, card, validation, training)
    card.write(out)
    return card


def _trained(
    name: str,
    shape: NetworkConfig,
    project: Project,
    training: list[Track],
    validation: list[Track],
    out: Path,
    devices: Devices | None,
    progress: bool,
) -> IPNet:
    """A network of the preset, trained."""
    config = project.training_config
    if project.start:
        network = load(find(project.start) / f"{name}{SAFETENSORS}", shape)
    else:
        torch.manual_seed(project.seed)
        network = IPNet(shape)
    begin(network, training, config.mount_deg, np.random.default_rng(project.seed))
    train(
        network,
        config,
        training,
        validation,
        out / "logs" / name,
        seed=project.seed,
        minutes=project.minutes,
        devices=devices,
        progress=progress,
    )
    return network


def _tracks(project: Project, cache: Path) -> tuple[list[Track], list[Track]]:
    """Recordings to learn from, and to choose by."""
    if not project.split:
        if not project.validation:
            raise ConfigError("no recordings to validate on; expected --validate FOLDER or --split NAME")
        training = open_tracks(project.training, project.labels, cache)
        return training, open_tracks(project.validation, project.labels, cache)
    parts = split(project.split)
    training = open_tracks(project.training, project.labels, cache, parts.train)
    return training, open_tracks(project.training, project.labels, cache, parts.validate)
