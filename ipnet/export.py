"""Weights on disk: safetensors to train on, ONNX to run."""

import warnings
from pathlib import Path

import torch
from safetensors.torch import load_file, save_file
from torch import Tensor, nn

from ipnet.errors import ConfigError
from ipnet.model import IPNet
from ipnet.presets import NetworkConfig
from ipnet.weights import Card

SAFETENSORS, ONNX = ".safetensors", ".onnx"
OPSET = 17


def save(network: IPNet, path: Path) -> None:
    """Write a network's weights."""
    partial = path.with_suffix(".partial")
    save_file({name: value.contiguous() for name, value in network.state_dict().items()}, partial)
    partial.replace(path)


def load(path: Path, config: NetworkConfig) -> IPNet:
    """A network with the weights in a file.

    Raises:
        ConfigError: the file is missing, or holds another network's weights.
    """
    if not path.is_file():
        raise ConfigError(f"{path}: no such file; expected weights as `python -m ipnet train` writes them")
    network = IPNet(config)
    try:
        network.load_state_dict(load_file(path))
    except RuntimeError as error:
        raise ConfigError(f"{path}: not the weights of {config}: {error}") from error
    network.eval()
    return network


class _Exported(nn.Module):
    """A network whose every output depends on its input: others lose their names."""

    def __init__(self, network: IPNet) -> None:
        super().__init__()
        self.network = network

    def forward(self, window: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """`IPNet.forward`."""
        bias, scale, R = self.network(window)
        return bias, scale, R + 0.0 * window[:, :1, :1]


def export(network: IPNet, path: Path) -> None:
    """Write a network as ONNX: `window` (1, n, 6) to `bias` (1, 6), `scale` (1, 6) and `frame` (1, 3, 3), float32."""
    network.eval()
    partial = path.with_suffix(".partial")
    example = torch.zeros(1, network.config.samples, 6)
    example[..., 5] = 9.81
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of traced shapes: they are constant
        torch.onnx.export(
            _Exported(network),
            (example,),
            partial,
            input_names=["window"],
            output_names=["bias", "scale", "frame"],
            opset_version=OPSET,
            dynamo=False,
        )
    partial.replace(path)


def export_folder(folder: Path, out: Path | None = None) -> list[Path]:
    """Write the ONNX files of a folder of weights, beside their safetensors or into another folder.

    Raises:
        ConfigError: the folder does not hold weights.
    """
    written = []
    for name, card in Card.read(folder).networks.items():
        path = (out or folder) / f"{name}{ONNX}"
        path.parent.mkdir(parents=True, exist_ok=True)
        export(load(folder / f"{name}{SAFETENSORS}", card.config), path)
        written.append(path)
    return written
