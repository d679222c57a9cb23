"""Training with Lightning: steps, validation, checkpoints, logs."""

import logging
import math
from dataclasses import dataclass, replace
from datetime import timedelta
from pathlib import Path
from typing import Any

import lightning as L
import numpy as np
import torch
from lightning.pytorch.callbacks import Callback, EarlyStopping, ModelCheckpoint
from lightning.pytorch.loggers import CSVLogger, TensorBoardLogger
from torch import Tensor
from torch.utils.data import DataLoader

from ipnet.dataset import Track, Windows, random_windows, regular_windows
from ipnet.model import BiasNetwork, IPNet, turned, upright
from ipnet.presets import TrainingConfig
from ipnet.regression import relations
from navcore.arrays import Rotations

FIRST = 0.25
"""Weight in the loss of the estimate that refinements start from."""
MOTION = ("A", "B", "C", "n", "log_w", "log_scale")
MOTION_RATE = 0.2
"""Of the learning rate, for the motion model: it begins near where it ends."""
WINDOWS = 160
"""That a network begins with, about."""
LAST = "last.ckpt"

Batch = tuple[Tensor, Tensor]


@dataclass(frozen=True)
class Devices:
    """Lightning's own flags."""

    accelerator: str = "cpu"  # cpu, gpu, auto
    devices: int = 1  # how many
    strategy: str = "auto"  # how they share the work


class BiasModule(L.LightningModule):
    """A network and how it learns; windows are drawn anew in each epoch, from the seed and the epoch's number."""

    def __init__(
        self, network: BiasNetwork, config: TrainingConfig, training: list[Track], validation: list[Track], seed: int
    ) -> None:
        super().__init__()
        self.network = network
        self.config = config
        self._training = training
        self._seed = seed
        self._validation = regular_windows(validation, network.config, config.validation_every_s)
        self._errors: list[Tensor] = []
        self._losses: list[Tensor] = []

    def train_dataloader(self) -> DataLoader[Batch]:
        """This epoch's windows."""
        rng = np.random.default_rng([self._seed, self.current_epoch])
        drawn = random_windows(self._training, self.network.config, self.config.windows, self.config.mount_deg, rng)
        order = rng.permutation(len(drawn))
        shuffled = Windows(drawn.config, drawn.tracks, [drawn.places[k] for k in order])
        return DataLoader(shuffled, batch_size=self.config.batch)

    def val_dataloader(self) -> DataLoader[Batch]:
        """The same windows in each epoch."""
        return DataLoader(self._validation, batch_size=self.config.batch)

    def training_step(self, batch: Batch, index: int) -> Tensor:
        """Loss of the last estimate, and some of the first."""
        window, label = batch
        first, *refined = self.network.estimates(window)
        total = loss(self.config.loss, *first, label).mean()
        if refined:
            last = loss(self.config.loss, *refined[-1], label).mean()
            total = last + FIRST * total
        self.log("loss", total, prog_bar=True)
        return total

    def validation_step(self, batch: Batch, index: int) -> None:
        """Keep errors until the epoch is over."""
        window, label = batch
        bias, scale = self.network.estimates(window)[-1]
        self._errors.append(bias - label)
        self._losses.append(loss(self.config.loss, bias, scale, label))

    def on_validation_epoch_end(self) -> None:
        """Log the loss and the error of each axis."""
        errors, losses = torch.cat(self._errors), torch.cat(self._losses)
        self._errors, self._losses = [], []
        self.log("val_loss", losses.mean(), prog_bar=True)
        for name, value in zip(AXES, errors.square().mean(0).sqrt(), strict=True):
            self.log(f"val_rmse_{name}", value)
        for name, value in zip(AXES, errors.abs().median(0).values, strict=True):
            self.log(f"val_median_{name}", value)

    def configure_optimizers(self) -> Any:
        """The config's optimizer and schedule."""
        c = self.config
        if c.optimizer == "rmsprop":
            optimizer: torch.optim.Optimizer = torch.optim.RMSprop(self.parameters(), lr=c.learning_rate)
        else:
            motion = [p for n, p in self.named_parameters() if n.rsplit(".", 1)[-1] in MOTION]
            known = {id(p) for p in motion}
            others = [p for p in self.parameters() if id(p) not in known]
            groups: list[dict[str, Any]] = [
                {"params": others},
                {"params": motion, "weight_decay": 0.0, "lr": MOTION_RATE * c.learning_rate},
            ]
            optimizer = torch.optim.AdamW(groups, lr=c.learning_rate, weight_decay=1e-3)
        if c.schedule == "step":
            schedule: Any = torch.optim.lr_scheduler.StepLR(optimizer, 10, 0.1)
        else:
            schedule = torch.optim.lr_scheduler.LambdaLR(optimizer, lambda epoch: _cosine(epoch, c.epochs))
        return [optimizer], [schedule]


AXES = ("gx", "gy", "gz", "ax", "ay", "az")


def loss(kind: str, bias: Tensor, scale: Tensor, label: Tensor) -> Tensor:
    """(B,): the paper's eq. 4, mean absolute errors of both biases; or minus the logarithm of Laplace's density."""
    error = (bias - label).abs()
    if kind == "l1":
        return error[:, :3].mean(1) + error[:, 3:].mean(1)
    return (torch.log(2.0 * scale) + error / scale).mean(1)


def train(
    network: BiasNetwork,
    config: TrainingConfig,
    training: list[Track],
    validation: list[Track],
    out: Path,
    *,
    seed: int = 1,
    minutes: float | None = None,
    devices: Devices | None = None,
    progress: bool = True,
    module: type[BiasModule] = BiasModule,
) -> None:
    """Train `network`; afterwards it has the weights with the best validation.

    Killed and called again with the same `out`, it goes on after the last epoch that was complete.

    Args:
        out: folder for checkpoints and logs.
        minutes: time after which training stops, or None.
        module: how it learns.

    Raises:
        LabelError: no recording is long enough.
    """
    devices = devices or Devices()
    torch.set_num_threads(1)
    network.train()
    learner = module(network, config, training, validation, seed)
    best = ModelCheckpoint(out, "best", monitor="val_loss", save_last=True, enable_version_counter=False)
    callbacks: list[Callback] = [best, EarlyStopping("val_loss", patience=config.patience)]
    logging.getLogger("lightning.pytorch").setLevel(logging.WARNING)
    trainer = L.Trainer(
        accelerator=devices.accelerator,
        devices=devices.devices,
        strategy=devices.strategy,
        max_epochs=config.epochs,
        max_time=None if minutes is None else timedelta(minutes=minutes),
        callbacks=callbacks,
        logger=[CSVLogger(out, name="csv"), TensorBoardLogger(out, name="", version="")],
        gradient_clip_val=None if config.loss == "l1" else 1.0,
        reload_dataloaders_every_n_epochs=1,
        log_every_n_steps=10,
        num_sanity_val_steps=0,
        enable_progress_bar=progress,
        enable_model_summary=False,
    )
    last = out / LAST
    trainer.fit(learner, ckpt_path=last if last.is_file() else None, weights_only=False)
    chosen = Path(best.best_model_path)
    if chosen.is_file():
        learner.load_state_dict(torch.load(chosen, weights_only=False)["state_dict"])
    network.eval()


def begin(network: IPNet, training: list[Track], mount_deg: float, rng: np.random.Generator) -> None:
    """Give a network what needs no training.

    Where the mount is fixed, its frame has the mean specific force of the recordings along z. Its motion model is what
    regression finds in them, if their velocities are known, and its scales are right for that.
    """
    config = network.config
    if config.centred and config.mount == "fixed":
        force = np.mean([t.imu.accel.mean(axis=0) - t.bias[:, 3:].mean(axis=0) for t in training], axis=0)
        network.R_NB.copy_(upright(torch.from_numpy(force[None].astype(np.float32)))[0])
    if network.motion is None:
        return
    drawn = random_windows(training, config, 1 + WINDOWS // len(training), mount_deg, rng)
    found = relations(replace(drawn, places=[_in_network_frame(network, drawn, k) for k in range(len(drawn))]))
    if found is not None:
        network.motion.begin(found)
    _begin_scales(network, drawn)


def _in_network_frame(network: IPNet, windows: Windows, k: int) -> tuple[int, int, Rotations]:
    """A window's place with the rotation to where the network sees it."""
    track, begin_ns, R = windows.places[k]
    values, _ = windows[k]
    R_NB = network.mount(values[None])[0].double().numpy()
    return track, begin_ns, R_NB @ R


def _begin_scales(network: IPNet, windows: Windows) -> None:
    """Set how wrong estimates are before and after refinement to what the windows show."""
    rows = [windows[k] for k in range(len(windows))]
    window, label = (torch.stack(part) for part in zip(*rows, strict=True))
    network.eval()
    for which, parameter in ((0, network.spread[2].bias), (-1, network.log_scale)):
        with torch.no_grad():
            R = network.mount(window)
            bias, scale = network.in_own_frame(window, R)[which]
            error = (bias - turned(label[:, None], R)[..., 0]).abs()
            parameter.add_((error / scale).mean(0).log())


def _cosine(epoch: int, epochs: int) -> float:
    return min((epoch + 1) / 3.0, 0.01 + 0.99 * 0.5 * (1.0 + math.cos(math.pi * min(epoch / epochs, 1.0))))
