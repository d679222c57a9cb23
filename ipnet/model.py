"""IPNet: raw IMU windows become biases (Yi et al., section III-B), and how sure they are."""

import torch
from torch import Tensor, nn

from ipnet.presets import NetworkConfig
from ipnet.refinement import Belief, MotionModel, refine
from navcore.imu import GRAVITY

SIGMA = (0.05, 0.05, 0.05, 0.3, 0.3, 0.3)  # rad/s, m/s^2: the scale of outputs, and of their spread before training
INPUT = (1.0, 1.0, 1.0, 2.0, 2.0, 2.0)  # rad/s, m/s^2: the scale of inputs


class ResidualBlock(nn.Module):
    """(B, in, n) to (B, out, n): convolution, batch norm, PReLU, beside a pointwise convolution."""

    def __init__(self, inputs: int, outputs: int, kernel: int) -> None:
        super().__init__()
        self.main = nn.Sequential(
            nn.Conv1d(inputs, outputs, kernel, padding=kernel // 2), nn.BatchNorm1d(outputs), nn.PReLU()
        )
        self.skip = nn.Conv1d(inputs, outputs, 1)

    def forward(self, x: Tensor) -> Tensor:
        """(B, in, n) to (B, out, n)."""
        return self.main(x) + self.skip(x)


class Encoder(nn.Module):
    """(B, n, 6) to (B, n // 16, channels): four residual blocks, each with a max-pooling by two."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        blocks: list[nn.Module] = []
        inputs = 6
        for outputs in config.channels:
            blocks += [ResidualBlock(inputs, outputs, config.kernel), nn.MaxPool1d(2)]
            inputs = outputs
        self.blocks = nn.Sequential(*blocks)

    def forward(self, x: Tensor) -> Tensor:
        """(B, n, 6) to (B, n // 16, channels)."""
        return self.blocks(x.transpose(1, 2)).transpose(1, 2)


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
        return self.output((scores @ v).transpose(1, 2).reshape(batch, m, width))


class Decoder(nn.Module):
    """(B, m, hidden) to (B, predictions, 3), from the last state and the mean of all."""

    def __init__(self, hidden: int, predictions: int) -> None:
        super().__init__()
        self.layers = nn.Sequential(nn.Linear(2 * hidden, hidden), nn.PReLU(), nn.Linear(hidden, 3 * predictions))
        self.predictions = predictions

    def forward(self, x: Tensor) -> Tensor:
        """(B, m, hidden) to (B, predictions, 3)."""
        return self.layers(torch.cat([x[:, -1], x.mean(1)], dim=1)).view(-1, self.predictions, 3)


class MotionHead(nn.Module):
    """(B, m, hidden) to what the platform's motion obeys, block by block."""

    def __init__(self, hidden: int, rows: int) -> None:
        super().__init__()
        half = rows // 2
        eye = torch.eye(3).repeat((rows + 2) // 3, 1)[:rows]
        by_velocity, by_force = eye * 0.3, eye * 1.5  # the first rows as of drag, the others as of no velocity
        by_force[half:] = 0.0
        self.A, self.B, self.C = nn.Parameter(by_velocity), nn.Parameter(by_force), nn.Parameter(torch.zeros(rows, 3))
        self.rest = nn.Linear(hidden, 2 * rows)
        nn.init.zeros_(self.rest.weight)
        nn.init.zeros_(self.rest.bias)

    def forward(self, x: Tensor) -> MotionModel:
        """The model of each window."""
        n, log_w = self.rest(x).transpose(1, 2).chunk(2, dim=1)
        return MotionModel(self.A, self.B, self.C, n, torch.exp(log_w.clamp(-6.0, 6.0)))


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

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.config = config
        self.encoder = Encoder(config)
        self.sequence = SequenceModel(config.channels[-1], config.hidden, config.heads)
        self.gyro = Decoder(config.hidden, config.predictions)
        self.accel = Decoder(config.hidden, config.predictions)
        self.spread = nn.Sequential(
            nn.Linear(2 * config.hidden, config.hidden), nn.PReLU(), nn.Linear(config.hidden, 6)
        )
        self.motion = MotionHead(config.hidden, config.residuals) if config.refinements else None
        self.log_scale = nn.Parameter(torch.zeros(config.refinements, 6))  # of a refinement's sd, by which it is wrong
        self.register_buffer("base", torch.tensor([0.0, 0.0, 0.0, 0.0, 0.0, -GRAVITY if config.centred else 0.0]))
        self.register_buffer("R_NB", torch.eye(3))  # from the body to the network's frame
        self.register_buffer("output_scale", torch.tensor(SIGMA))
        self.register_buffer("input_scale", torch.tensor(INPUT))

    def forward(self, window: Tensor) -> tuple[Tensor, Tensor]:
        """The last estimate.

        Args:
            window: (B, n, 6) gyro [rad/s], accel [m/s^2], means over samples.

        Returns:
            (B, 6) b_g [rad/s], b_a [m/s^2], and the scales of their Laplace distributions, (B, 6).
        """
        return self.estimates(window)[-1]

    def estimates(self, window: Tensor) -> list[tuple[Tensor, Tensor]]:
        """What `forward` gives, before and after each refinement."""
        R = self._mount(window)
        turned = (window.unflatten(2, (2, 3)) @ R.transpose(1, 2)[:, None]).flatten(2)
        found = self._in_network_frame(turned)
        return [(_turned_back(bias, R), torch.sqrt(_turned_back(sigma**2, R**2))) for bias, sigma in found]

    def _mount(self, window: Tensor) -> Tensor:
        """(B, 3, 3) or (1, 3, 3) from the body to the network's frame."""
        if self.config.mount == "fixed":
            return self.R_NB[None]
        return upright(window[:, :, 3:].mean(1))

    def _in_network_frame(self, window: Tensor) -> list[tuple[Tensor, Tensor]]:
        """Estimates, all in the network's frame."""
        centre = window.mean(1) if self.config.centred else torch.zeros_like(window[:, 0])
        x = self.sequence(self.encoder((window - centre[:, None]) / self.input_scale))
        decoded = torch.cat([self.gyro(x).mean(1), self.accel(x).mean(1)], dim=1)
        bias = centre + self.base + self.output_scale * decoded
        log_sigma = self.spread(torch.cat([x[:, -1], x.mean(1)], dim=1)).clamp(-7.0, 3.0)
        sigma = self.output_scale * torch.exp(log_sigma)
        found = [(bias, sigma)]
        if self.motion is None:
            return found
        model = self.motion(x)
        samples = window.transpose(1, 2).contiguous()
        first = Belief(bias, 2.0 * sigma**2, None, torch.zeros_like(bias[:, :3]))
        now = first
        for log_scale in self.log_scale:
            now = refine(samples, 1.0 / self.config.rate_hz, first, now, model)
            found.append((now.bias, torch.exp(log_scale) * torch.sqrt(0.5 * now.variance)))
        return found


def upright(force: Tensor) -> Tensor:
    """(B, 3, 3) a rotation that takes forces (B, 3) to z: the shortest one, after half a turn about x if z < 0."""
    x, y, z = (force / force.norm(dim=1, keepdim=True)).unbind(1)
    s = torch.where(z < 0.0, -torch.ones_like(z), torch.ones_like(z))
    y, z = s * y, s * z
    k = 1.0 / (1.0 + z)
    rows = [1.0 - k * x * x, -s * k * x * y, -s * x, -k * x * y, s * (1.0 - k * y * y), -s * y, x, s * y, s * z]
    return torch.stack(rows, dim=1).view(-1, 3, 3)


def _turned_back(values: Tensor, R: Tensor) -> Tensor:
    """(B, 6) of the network's frame in B; R (B, 3, 3) leads to the network's frame."""
    return (values.view(-1, 2, 3) @ R).flatten(1)
