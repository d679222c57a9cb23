"""Networks that others have proposed, small, with the interface of `ipnet.model.IPNet`; torch is for training only."""

import torch
from torch import Tensor, nn

from ipnet.model import INPUT, SIGMA, BiasNetwork
from ipnet.presets import NetworkConfig

CONFIG = NetworkConfig(512, 51.2, pieces=())
"""Windows of 10 s, as both networks see them in training."""
STEP = 64
"""Samples between two estimates of the recursive network: 1.25 s."""
HIDDEN = 48


class Recursion(nn.Module):
    """One step: samples (B, 64, 6) and the past bias (B, 6) to the bias now (B, 6) and its scale (B, 6)."""

    output_scale: Tensor
    input_scale: Tensor

    def __init__(self, hidden: int) -> None:
        super().__init__()
        self.lstm = nn.LSTM(12, hidden, batch_first=True)
        self.out = nn.Linear(hidden, 12)
        nn.init.zeros_(self.out.weight)
        nn.init.zeros_(self.out.bias)
        self.register_buffer("output_scale", torch.tensor(SIGMA))
        self.register_buffer("input_scale", torch.tensor(INPUT))

    def forward(self, samples: Tensor, past: Tensor) -> tuple[Tensor, Tensor]:
        """The past bias corrects the samples, and is an input beside them."""
        corrected = (samples - past[:, None]) / self.input_scale
        beside = (past / self.output_scale)[:, None].expand(-1, samples.shape[1], -1)
        x, _ = self.lstm(torch.cat([corrected, beside], dim=2))
        change, log_sigma = self.out(x[:, -1]).chunk(2, dim=1)
        return past + self.output_scale * change, self.output_scale * torch.exp(log_sigma.clamp(-7.0, 3.0))


class Recursive(BiasNetwork):
    """An LSTM that takes its own past bias as input (the idea of Buchanan et al., "Deep IMU bias inference for robust
    visual-inertial odometry with factor graphs", IEEE RA-L 2023).

    In training it starts from the mean bias of the training recordings with an error as large as their spread, and then
    lives on what it has said itself, as it will later.
    """

    start: Tensor
    spread: Tensor

    def __init__(self, start: Tensor, spread: Tensor) -> None:
        super().__init__()
        self.config = CONFIG
        self.step = Recursion(HIDDEN)
        self.register_buffer("start", start)
        self.register_buffer("spread", spread)

    def forward(self, window: Tensor) -> tuple[Tensor, Tensor]:
        """What it says at a window's end: (B, 6) bias and scale."""
        return self.estimates(window)[-1]

    def estimates(self, window: Tensor) -> list[tuple[Tensor, Tensor]]:
        """What it says after each step."""
        past = self.start.expand(len(window), 6)
        if self.training:
            past = past + self.spread * torch.randn_like(past)
        found = []
        for k in range(0, window.shape[1], STEP):
            bias, scale = self.step(window[:, k : k + STEP], past)
            found.append((bias, scale))
            past = bias.detach()
        return found


class Corrector(BiasNetwork):
    """A correction for each sample, learned through what the corrected samples integrate to (the idea of Zhang et al.,
    "IMU data processing for inertial aided navigation: a recurrent neural network based approach", ICRA 2021).

    The mean correction of a window is its statement of the bias; that network knows no uncertainty, so all windows have
    one scale.
    """

    start: Tensor
    output_scale: Tensor
    input_scale: Tensor

    def __init__(self, start: Tensor) -> None:
        super().__init__()
        self.config = CONFIG
        self.encoder = nn.Sequential(
            nn.Conv1d(6, 32, 7, padding=3), nn.PReLU(), nn.Conv1d(32, HIDDEN, 7, padding=3), nn.PReLU()
        )
        self.memory = nn.GRU(HIDDEN, HIDDEN, batch_first=True)
        self.out = nn.Linear(HIDDEN, 6)
        nn.init.zeros_(self.out.weight)
        nn.init.zeros_(self.out.bias)
        self.log_scale = nn.Parameter(torch.zeros(6))
        self.register_buffer("start", start)
        self.register_buffer("output_scale", torch.tensor(SIGMA))
        self.register_buffer("input_scale", torch.tensor(INPUT))

    def forward(self, window: Tensor) -> tuple[Tensor, Tensor]:
        """(B, 6) the mean correction, and its scale."""
        mean = self.correction(window).mean(1)
        return mean, (self.output_scale * torch.exp(self.log_scale)).expand_as(mean)

    def estimates(self, window: Tensor) -> list[tuple[Tensor, Tensor]]:
        """The one there is."""
        return [self(window)]

    def correction(self, window: Tensor) -> Tensor:
        """(B, n, 6) what is to be subtracted from the samples."""
        x = self.encoder((window / self.input_scale).transpose(1, 2)).transpose(1, 2)
        x, _ = self.memory(x)
        correction: Tensor = self.start + self.output_scale * self.out(x)
        return correction


def integrate(samples: Tensor, dt: float) -> tuple[Tensor, Tensor, Tensor]:
    """Samples (B, n, 6) to rotation (B, 3, 3), velocity and position (B, 3) after them, from rest at the origin, in the
    first sample's frame and without gravity.
    """
    half = _exp(0.5 * dt * samples[..., :3])  # (B, n, 3, 3)
    R = torch.eye(3).expand(len(samples), 3, 3)
    v = p = torch.zeros_like(samples[:, 0, :3])
    for k in range(samples.shape[1]):
        R_mid = R @ half[:, k]
        dv = dt * (R_mid @ samples[:, k, 3:, None])[..., 0]
        p, v, R = p + dt * (v + 0.5 * dv), v + dv, R_mid @ half[:, k]
    return R, v, p


def increment_loss(corrected: Tensor, truth: Tensor, dt: float) -> Tensor:
    """(B,): distance of what both integrate to, in units of a bias error that lasts a step."""
    parts = [x.reshape(-1, STEP, 6) for x in (corrected, truth)]
    (R, v, p), (R_true, v_true, p_true) = (integrate(x, dt) for x in parts)
    turn = R_true.transpose(1, 2) @ R
    theta = 0.5 * torch.stack(
        [turn[:, 2, 1] - turn[:, 1, 2], turn[:, 0, 2] - turn[:, 2, 0], turn[:, 1, 0] - turn[:, 0, 1]], dim=1
    )
    seconds = STEP * dt
    off = [theta / seconds / SIGMA[0], (v - v_true) / seconds / SIGMA[3], 2.0 * (p - p_true) / seconds**2 / SIGMA[3]]
    return torch.cat(off, dim=1).abs().mean(1).view(len(corrected), -1).mean(1)


def _exp(phi: Tensor) -> Tensor:
    """(..., 3) to (..., 3, 3), to third order: half a sample's turn is small."""
    zero = torch.zeros_like(phi[..., 0])
    x, y, z = phi.unbind(-1)
    K = torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], dim=-1).view(*phi.shape, 3)
    KK = K @ K
    R: Tensor = torch.eye(3) + K + 0.5 * KK + K @ KK / 6.0
    return R
