"""The network: shapes, size, frames, and that what is added to its input comes out again."""

import pytest
import torch

from ipnet.errors import ConfigError
from ipnet.model import IPNet, Slope, upright
from ipnet.presets import PRESETS, NetworkConfig, preset
from navcore.imu import GRAVITY
from tests.ipnet.flying import SMALL

SHAPES = {f"{p}-{n}": shape for p, preset in PRESETS.items() for n, shape in preset.networks.items()}


def hovering(config, batch=2, seed=1):
    window = 0.1 * torch.randn(batch, config.samples, 6, generator=torch.Generator().manual_seed(seed))
    window[..., 5] += GRAVITY
    return window


@pytest.mark.parametrize("name", SHAPES)
def test_a_window_becomes_biases_and_scales(name):
    network = IPNet(SHAPES[name]).eval()
    assert sum(p.numel() for p in network.parameters()) <= 1_000_000
    x = network.sequence(network.encoder(hovering(network.config).transpose(1, 2)))
    assert x.shape == (2, network.config.samples // 16, network.config.hidden)
    assert network.gyro(x).shape == network.accel(x).shape == (2, 50, 3)
    with torch.no_grad():
        estimates = network.estimates(hovering(network.config))
    assert len(estimates) == 1 + len(network.config.pieces)
    for bias, scale in estimates:
        assert bias.shape == scale.shape == (2, 6)
        assert (scale > 0.0).all()


def test_the_papers_window_is_five_seconds_at_200_hz():
    grid = preset("paper").networks["long"].grid(1.0)
    assert (grid.samples, grid.seconds) == (1000, 5.0)


def test_an_unknown_preset_is_answered_with_the_known():
    with pytest.raises(ConfigError, match="default, paper"):
        preset("best")


def test_a_window_that_blocks_do_not_fill_is_refused():
    with pytest.raises(ConfigError, match="10 pieces need a multiple of 160"):
        NetworkConfig(1000, 25.0)


def test_what_is_added_to_the_input_comes_out():
    torch.manual_seed(3)
    network = IPNet(SMALL).eval()
    window = hovering(SMALL)
    offset = torch.tensor([0.05, -0.02, 0.03, 0.3, -0.2, 0.1])
    with torch.no_grad():
        for (bias, scale), (moved, other) in zip(
            network.estimates(window), network.estimates(window + offset), strict=True
        ):
            torch.testing.assert_close(moved - bias, offset.expand(2, 6), atol=2e-4, rtol=0.0)
            torch.testing.assert_close(scale, other, atol=1e-5, rtol=1e-3)


def test_a_plain_network_may_ignore_it():
    network = IPNet(NetworkConfig(64, 24.0, centred=False, pieces=())).eval()
    with torch.no_grad():
        network.gyro.layers[2].weight.zero_()
        assert torch.equal(
            network(hovering(network.config))[0][:, :3], network(hovering(network.config) + 1.0)[0][:, :3]
        )


def test_forces_become_upright():
    forces = torch.randn(100, 3, generator=torch.Generator().manual_seed(1))
    R = upright(forces)
    expected = torch.stack([torch.zeros(100), torch.zeros(100), forces.norm(dim=1)], dim=1)
    torch.testing.assert_close((R @ forces[..., None])[..., 0], expected, atol=1e-5, rtol=0.0)
    torch.testing.assert_close(R @ R.transpose(1, 2), torch.eye(3).expand(100, 3, 3), atol=1e-5, rtol=0.0)
    assert torch.linalg.det(R).min() > 0.99


@pytest.mark.parametrize("mount", ["fixed", "any"])
def test_turning_body_and_network_together_turns_the_answer(mount):
    torch.manual_seed(4)
    network = IPNet(NetworkConfig(64, 24.0, mount=mount, pieces=())).eval()
    window = hovering(network.config)
    R = torch.tensor([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])  # about x: what `upright` undoes
    turned = (window.view(2, 64, 2, 3) @ R.T).flatten(2)
    with torch.no_grad():
        before, *_ = network(window)
        network.R_NB.copy_(R.T)
        after, *_ = network(turned)
    atol = 1e-4 if mount == "fixed" else 0.05  # the mean force is nearly, not quite, along z
    torch.testing.assert_close((before.view(2, 2, 3) @ R.T).flatten(1), after, atol=atol, rtol=0.0)


def test_scales_are_of_the_networks_frame():
    torch.manual_seed(5)
    network = IPNet(NetworkConfig(64, 24.0, pieces=())).eval()
    network.R_NB.copy_(torch.tensor([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]))
    window = hovering(network.config)
    with torch.no_grad():
        bias, scale, R = network(window)
        found, in_B = network.estimates(window)[-1]
    torch.testing.assert_close(bias, found)
    torch.testing.assert_close(scale.view(2, 2, 3) @ R, in_B.view(2, 2, 3))  # axes change places


def test_activations_are_exported_as_what_they_are(monkeypatch):
    slope = Slope()
    x = torch.linspace(-2.0, 2.0, 9)
    plain = slope(x)
    monkeypatch.setattr(torch.onnx, "is_in_onnx_export", lambda: True)
    assert torch.equal(slope(x), plain)
