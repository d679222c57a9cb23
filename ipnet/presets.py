"""How networks look and how they are trained: `paper` to the letter, `default` ours."""

from dataclasses import dataclass, field

from ipnet.errors import ConfigError
from ipnet.windows import Grid


@dataclass(frozen=True)
class NetworkConfig:
    """The shape of a network.

    Attributes:
        samples, rate_hz: of a window.
        channels: of the four residual blocks.
        kernel: of their convolutions.
        hidden: of the GRUs.
        heads: of the attention.
        predictions: values that each decoder gives; their mean counts.
        centred: the window's mean is taken from the input and added to the output: what is added to the
            measurements then comes out again exactly, whatever the weights are.
        mount: "fixed": the IMU sits in the platform in one way, which is found in the training data; "any": each
            window is turned so that its mean specific force is along z.
        pieces: in how many of equal length each refinement by dead reckoning cuts the window: errors of a start grow
            with the length. None: no refinement.
    """

    samples: int
    rate_hz: float
    channels: tuple[int, int, int, int] = (24, 32, 48, 64)
    kernel: int = 5
    hidden: int = 64
    heads: int = 4
    predictions: int = 50
    centred: bool = True
    mount: str = "fixed"
    pieces: tuple[int, ...] = (10, 5, 2, 1, 1)

    def __post_init__(self) -> None:
        for pieces in self.pieces:
            if self.samples % (pieces * BLOCK):
                raise ConfigError(f"samples is {self.samples}; {pieces} pieces need a multiple of {pieces * BLOCK}")
        if self.mount not in ("fixed", "any"):
            raise ConfigError(f"mount is {self.mount!r}, expected fixed or any")
        if self.hidden % self.heads:
            raise ConfigError(f"hidden is {self.hidden}, expected a multiple of heads, {self.heads}")

    def grid(self, every_s: float) -> Grid:
        """The windows it takes."""
        return Grid(self.samples / self.rate_hz, self.rate_hz, every_s)


BLOCK = 16
"""Samples of the window behind one position of the encoder's output: four poolings by two."""
STEP = 4
"""Samples that refinements see as one."""


@dataclass(frozen=True)
class TrainingConfig:
    """How a network is trained.

    Attributes:
        loss: "l1" the paper's, or "laplace": likelihood with a scale per axis.
        optimizer: "rmsprop" or "adamw".
        learning_rate: at the start.
        schedule: "step" x0.1 every ten epochs, or "cosine" down to a hundredth, after two epochs of warming up.
        batch: windows in a step.
        windows: drawn from each recording in an epoch, with random beginnings.
        epochs: at most.
        patience: epochs without a better validation before training stops.
        mount_deg: sd of the rotation by which the IMU is mounted differently, per axis; 180 or more for any.
        validation_every_s: between validation windows.
    """

    loss: str = "laplace"
    optimizer: str = "adamw"
    learning_rate: float = 1e-3
    schedule: str = "cosine"
    batch: int = 16
    windows: int = 4
    epochs: int = 30
    patience: int = 10
    mount_deg: float = 0.0
    validation_every_s: float = 20.0


@dataclass(frozen=True)
class Preset:
    """Networks by the length of what they see, and their training; `medium` has the weights of `long`."""

    networks: dict[str, NetworkConfig]
    training: TrainingConfig = field(default_factory=TrainingConfig)


PRESETS = {
    "default": Preset(
        {
            "short": NetworkConfig(256, 51.2, pieces=(2, 1, 1, 1)),
            "medium": NetworkConfig(480, 24.0, pieces=(5, 2, 1, 1)),
            "long": NetworkConfig(960, 24.0),
        }
    ),
    "paper": Preset(
        {"long": NetworkConfig(1000, 200.0, channels=(32, 64, 128, 128), hidden=128, centred=False, pieces=())},
        TrainingConfig("l1", "rmsprop", 1e-6, "step", batch=32, windows=40),
    ),
}


def preset(name: str) -> Preset:
    """The preset of that name.

    Raises:
        ConfigError: there is none; the message lists the names.
    """
    if name not in PRESETS:
        raise ConfigError(f"preset {name!r} is unknown; known are {', '.join(PRESETS)}")
    return PRESETS[name]
