"""Training: the same again, going on, and a toy that is learned."""

import csv

import numpy as np
import pytest
import torch

from ipnet.dataset import random_windows, regular_windows
from ipnet.errors import LabelError
from ipnet.model import IPNet
from ipnet.presets import TrainingConfig
from ipnet.training import LAST, BiasModule, begin, loss, train
from tests.ipnet.flying import SMALL, flight

CONFIG = TrainingConfig(epochs=2, batch=8, windows=4, validation_every_s=4.0)


@pytest.fixture(scope="module")
def flights():
    return [flight(k) for k in range(4)]


class Killed(BiasModule):
    def on_train_epoch_start(self):
        if self.current_epoch == 1:
            raise RuntimeError("killed")


def trained(flights, out, module=BiasModule):
    torch.manual_seed(1)
    network = IPNet(SMALL)
    begin(network, flights[:3], CONFIG.mount_deg, np.random.default_rng(1))
    train(network, CONFIG, flights[:3], flights[3:], out, seed=1, progress=False, module=module)
    return network


def curve(out):
    with max(out.glob("csv/*/metrics.csv")).open() as file:
        return [row["val_loss"] for row in csv.DictReader(file) if row.get("val_loss")]


def test_the_same_seed_gives_the_same_curve_also_when_interrupted(flights, tmp_path):
    trained(flights, tmp_path / "a")
    once = curve(tmp_path / "a")
    assert len(once) == 2
    with pytest.raises(RuntimeError, match="killed"):
        trained(flights, tmp_path / "b", module=Killed)
    assert (tmp_path / "b" / LAST).is_file()
    again = trained(flights, tmp_path / "b")
    assert curve(tmp_path / "b") == once[1:]
    assert not again.training


def test_a_toy_is_learned_and_its_scales_are_right(flights, tmp_path):
    network = trained(flights, tmp_path)
    windows = regular_windows([flight(9), flight(10)], SMALL, 3.0)
    window, label = (torch.stack(x) for x in zip(*(windows[k] for k in range(len(windows))), strict=True))
    with torch.no_grad():
        first, *_, last = network.estimates(window)
    error = (last[0] - label).abs()
    assert (error[:, :2].mean(0) < 0.2 * (first[0] - label).abs()[:, :2].mean(0)).all()
    assert (error < 20.0 * last[1]).all()


def test_loss_is_the_papers_sum_of_two_means():
    bias, label = torch.tensor([[1.0, 2.0, 3.0, 10.0, 20.0, 60.0]]), torch.zeros(1, 6)
    assert loss("l1", bias, torch.ones(1, 6), label).item() == pytest.approx(2.0 + 30.0)


def test_windows_are_the_tracks_and_mounts_turn_all_of_it(flights):
    drawn = random_windows(flights, SMALL, 2, 180.0, np.random.default_rng(1))
    assert len(drawn) == 8
    for k in range(len(drawn)):
        track, begin_ns, R = drawn.places[k]
        values, bias = flights[track].window(begin_ns, SMALL)
        np.testing.assert_allclose(drawn[k][0][:, 3:], values[:, 3:] @ R.T, atol=1e-5)
        np.testing.assert_allclose(drawn[k][1][:3], R @ bias[:3], atol=1e-6)
        np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)


def test_short_recordings_are_named():
    with pytest.raises(LabelError, match="none of 1 recordings is longer than a window of 8 s"):
        regular_windows([flight(1, seconds=5.0)], SMALL, 1.0)
