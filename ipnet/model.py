"""IPNet: raw IMU windows become biases (Yi et al., section III-B), and how sure they are."""

import numpy as np
import torch
from torch import Tensor, nn

from ipnet.presets import STEP, NetworkConfig
from ipnet.refinement import Belief, MotionModel, refine
from ipnet.regression import Relations
from ipnet.steps import condensed
from navcore.imu import GRAVITY

SIGMA = (0.05, 0.05, 0.05, 0.3, 0.3, 0.3)  # rad/s, m/s^2: the scale of outputs, and of their spread before training
ROWS = 6  # of the motion model: three begin with the specific force, three with the velocity
INPUT = (1.0, 1.0, 1.0, 2.0, 2.0, 2.0)  # rad/s, m/s^2: the scale of inputs


class Slope(nn.PReLU):
    """PReLU with one slope, which is exported as LeakyRelu: the same, and five times as fast in onnxruntime."""

    def forward(self, x: Tensor) -> Tensor:
        """(...) to the same."""
        if torch.onnx.is_in_onnx_export():
            return nn.functional.leaky_relu(x, self.weight.item())
        return super().forward(x)


class ResidualBlock(nn.Module):
    """(B, in, n) to (B, out, n): convolution, batch norm, PReLU, beside a pointwise convolution."""

    def __init__(self, inputs: int, outputs: int, kernel: int) -> None:
        super().__init__()
        self.main = nn.Sequential(
            nn.Conv1d(inputs, outputs, kernel, padding=kernel // 2), nn.BatchNorm1d(outputs), Slope()
        )
        self.skip = nn.Conv1d(inputs, outputs, 1)

    def forward(self, x: Tensor) -> Tensor:
        """(B, in, n) to (B, out, n)."""
        y: Tensor = self.main(x) + self.skip(x)
        return y


class Encoder(nn.Module):
    """(B, 6, n) to (B, n // 16, channels): four residual blocks, each with a max-pooling by two."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        blocks: list[nn.Module] = []
        inputs = 6
        for outputs in config.channels:
            blocks += [ResidualBlock(inputs, outputs, config.kernel), nn.MaxPool1d(2)]
            inputs = outputs
        self.blocks = nn.Sequential(*blocks)

    def forward(self, x: Tensor) -> Tensor:
        """(B, 6, n) to (B, n // 16, channels)."""
        y: Tensor = self.blocks(x)
        return y.transpose(1, 2)


class SequenceModel(nn.Module):
    """(B, m, channels) to (B, m, hidden): GRU, multi-head self-attention, GRU."""

    def __init__(self, inputs: int, hidden: int, heads: int) -> None:
        super().__init__()
        self.first = nn.GRU(inputs, hidden, batch_first=True)
        self.attention = Attention(hidden, heads)
        self.second = nn.GRU(hidden, hidden, batch_first=True)

    def forward(self, x: Tensor) -> Tensor:
        """(B, m, channels) to (B, m, hidden)."""
        x, _ = self.first(x)
        x = x + self.attention(x)
        x, _ = self.second(x)
        return x


class Attention(nn.Module):
    """Multi-head self-attention (Vaswani et al. 2017, eq. 1), in operations that every runtime has."""

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.heads = heads
        self.inputs = nn.Linear(width, 3 * width)
        self.output = nn.Linear(width, width)

    def forward(self, x: Tensor) -> Tensor:
        """(B, m, width) to the same."""
        batch, m, width = x.shape
        q, k, v = self.inputs(x).view(batch, m, 3, self.heads, width // self.heads).permute(2, 0, 3, 1, 4)
        scores = torch.softmax(q @ k.transpose(2, 3) * (width // self.heads) ** -0.5, dim=3)
        y: Tensor = self.output((scores @ v).transpose(1, 2).reshape(batch, m, width))
        return y


class Decoder(nn.Module):
    """(B, m, hidden) to (B, predictions, 3), from the last state and the mean of all."""

    def __init__(self, hidden: int, predictions: int) -> None:
        super().__init__()
        self.layers = nn.Sequential(nn.Linear(2 * hidden, hidden), Slope(), nn.Linear(hidden, 3 * predictions))
        self.predictions = predictions

    def forward(self, x: Tensor) -> Tensor:
        """(B, m, hidden) to (B, predictions, 3)."""
        y: Tensor = self.layers(torch.cat([x[:, -1], x.mean(1)], dim=1))
        return y.view(-1, self.predictions, 3)


class MotionHead(nn.Module):
    """(B, m, hidden) to what the platform's motion obeys, block by block."""

    def __init__(self, hidden: int) -> None:
        super().__init__()
        zero, eye = torch.zeros(3, 3), torch.eye(3)
        self.A = nn.Parameter(torch.cat([zero, eye]))
        self.B = nn.Parameter(torch.cat([eye, zero]))
        self.C = nn.Parameter(torch.zeros(ROWS, 3))
        self.n = nn.Parameter(torch.zeros(ROWS))
        self.log_w = nn.Parameter(torch.zeros(ROWS))
        self.rest = nn.Linear(hidden, 2 * ROWS)

    def begin(self, found: Relations) -> None:
        """Take over relations that regression has found."""
        with torch.no_grad():
            for name in ("A", "B", "C", "n"):
                getattr(self, name).copy_(torch.from_numpy(getattr(found, name)))
            self.log_w.copy_(torch.from_numpy(np.log(found.weight)))
            self.rest.weight.zero_()
            self.rest.bias.zero_()

    def forward(self, x: Tensor) -> MotionModel:
        """The model of each window."""
        n, log_w = self.rest(x).transpose(1, 2).chunk(2, dim=1)
        sd = torch.exp(-self.log_w)[:, None]
        log_w = torch.clamp(self.log_w[:, None] + log_w, -6.0, 6.0)
        return MotionModel(self.A, self.B, self.C, self.n[:, None] + sd * n, torch.exp(log_w))


class BiasNetwork(nn.Module):
    """What can be trained: windows (B, n, 6) become estimates of biases, the last of which counts most."""

    config: NetworkConfig

    def estimates(self, window: Tensor) -> list[tuple[Tensor, Tensor]]:
        """Biases (B, 6), and scales of their Laplace distributions (B, 6)."""
        raise NotImplementedError


class IPNet(BiasNetwork):
    """Biases of a window.

    (B, n, 6) raw gyro, accel → encoder (B, n // 16, channels) → GRU, attention, GRU (B, n // 16, hidden) → two
    decoders (B, 50, 3) each, whose means are b_g and b_a → refinements by what the platform's motion obeys
    (`ipnet.refinement`), which start from that estimate. Encoder and refinement see the same window.
    """

    base: Tensor  # (6,) where outputs begin: a level IMU's means, less its biases
    R_NB: Tensor  # (3, 3) from the body to the network's frame, where the mount is fixed
    output_scale: Tensor  # (6,)
    input_scale: Tensor  # (6,)

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.config = config
        self.encoder = Encoder(config)
        self.sequence = SequenceModel(config.channels[-1], config.hidden, config.heads)
        self.gyro = Decoder(config.hidden, config.predictions)
        self.accel = Decoder(config.hidden, config.predictions)
        self.spread = nn.Sequential(nn.Linear(2 * config.hidden, config.hidden), Slope(), nn.Linear(config.hidden, 6))
        self.motion = MotionHead(config.hidden) if config.pieces else None
        self.log_scale = nn.Parameter(torch.zeros(6))  # of the sd after refinement, by which it is wrong
        self.register_buffer("base", torch.tensor([0.0, 0.0, 0.0, 0.0, 0.0, -GRAVITY if config.centred else 0.0]))
        self.register_buffer("R_NB", torch.eye(3))
        self.register_buffer("output_scale", torch.tensor(SIGMA))
        self.register_buffer("input_scale", torch.tensor(INPUT))

    def forward(self, window: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """The last estimate.

        Args:
            window: (B, n, 6) gyro [rad/s], accel [m/s^2], means over samples.

        Returns:
            (B, 6) b_g [rad/s], b_a [m/s^2]; the scales of their Laplace distributions in the network's frame, (B, 6);
            and the rotation to that, (B, 3, 3) or (1, 3, 3).
        """
        R = self.mount(window)
        bias, scale = self.in_own_frame(window, R)[-1]
        return _turned_back(bias, R), scale, R

    def estimates(self, window: Tensor) -> list[tuple[Tensor, Tensor]]:
        """Biases (B, 6) and scales (B, 6) in B, before and after each refinement."""
        R = self.mount(window)
        found = self.in_own_frame(window, R)
        return [(_turned_back(bias, R), torch.sqrt(_turned_back(sigma**2, R**2))) for bias, sigma in found]

    def mount(self, window: Tensor) -> Tensor:
        """(B, 3, 3) or (1, 3, 3) from the body to the network's frame."""
        if self.config.mount == "fixed":
            return self.R_NB[None]
        return upright(window[:, :, 3:].mean(1))

    def in_own_frame(self, window: Tensor, R: Tensor) -> list[tuple[Tensor, Tensor]]:
        """Estimates in the network's frame, to which R (B, 3, 3) or (1, 3, 3) leads."""
        samples = turned(window, R)
        centre = samples.mean(2) if self.config.centred else torch.zeros_like(window[:, 0])
        x = self.sequence(self.encoder((samples - centre[..., None]) / self.input_scale[:, None]))
        decoded = torch.cat([self.gyro(x).mean(1), self.accel(x).mean(1)], dim=1)
        bias = centre + self.base + self.output_scale * decoded
        log_sigma = self.spread(torch.cat([x[:, -1], x.mean(1)], dim=1)).clamp(-7.0, 3.0)
        sigma = self.output_scale * torch.exp(log_sigma)
        found = [(bias, sigma)]
        if self.motion is None:
            return found
        model = self.motion(x)
        first = Belief(bias, 2.0 * sigma**2)
        now, dt = first, 1.0 / self.config.rate_hz
        for k, pieces in enumerate(self.config.pieces):
            if k == 0 or pieces == 1 < self.config.pieces[k - 1]:
                steps = condensed(samples, now.bias.to(window), dt)
                if not self.training:  # integrals need the digits; learning can do without
                    steps, model, first, now = (x.double() for x in (steps, model, first, now))
            now = refine(steps, STEP * dt, first, now, model, pieces)
            found.append((now.bias.to(window), torch.exp(self.log_scale) * torch.sqrt(0.5 * now.variance).to(window)))
        return found


def upright(force: Tensor) -> Tensor:
    """(B, 3, 3) a rotation that takes forces (B, 3) to z: the shortest one, after half a turn about x if z < 0."""
    x, y, z = (force / force.norm(dim=1, keepdim=True)).unbind(1)
    s = torch.where(z < 0.0, -torch.ones_like(z), torch.ones_like(z))
    y, z = s * y, s * z
    k = 1.0 / (1.0 + z)
    rows = [1.0 - k * x * x, -s * k * x * y, -s * x, -k * x * y, s * (1.0 - k * y * y), -s * y, x, s * y, s * z]
    return torch.stack(rows, dim=1).view(-1, 3, 3)


def turned(window: Tensor, R: Tensor) -> Tensor:
    """(B, 6, n) of (B, n, 6) in the network's frame, to which R (B, 3, 3) or (1, 3, 3) leads."""
    return (R[:, None] @ window.transpose(1, 2).unflatten(1, (2, 3))).flatten(1, 2)


def _turned_back(values: Tensor, R: Tensor) -> Tensor:
    """(B, 6) of the network's frame in B; R (B, 3, 3) leads to the network's frame."""
    return (values.view(-1, 2, 3) @ R).flatten(1)
