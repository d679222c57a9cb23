"""Rivals that learn: what their networks compute, and that what runs is what was trained."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from ipnet import assessment
from ipnet.dataset import Track
from ipnet.device import learn
from ipnet.errors import ConfigError, LabelError
from ipnet.preintegration import preintegrate
from ipnet.presets import TrainingConfig
from ipnet.recordings import Label, Recording
from ipnet.rivals import learning
from ipnet.rivals.learned import RivalCard
from ipnet.rivals.learning import Lessons, calibrate, learn_corrector, learn_recursive
from ipnet.rivals.networks import CONFIG, STEP, Corrector, Recursive, increment_loss, integrate
from ipnet.runs import cut
from navcore.imu import GRAVITY, ImuNoise, ImuSamples
from navcore.prior import load_prior

NOISE = ImuNoise(1e-4, 0.0, 1e-3, 0.0)


def recording(name, seed, seconds=40.0):
    rng = np.random.default_rng(seed)
    b = rng.normal(size=6) * np.repeat([0.01, 0.1], 3)
    t_ns = np.rint(np.arange(round(seconds * 51.2)) / 51.2 * 1e9).astype(np.int64)
    values = b + rng.normal(size=(len(t_ns), 6)) + [0.0, 0.0, 0.0, 0.0, 0.0, GRAVITY]
    imu = ImuSamples(t_ns, values[:, :3], values[:, 3:])
    return Recording(name, imu, NOISE, None, Label(name, b, 1e-12 * np.eye(6)))


@pytest.fixture
def lessons():
    recordings = [recording(name, k) for k, name in enumerate(("a", "b", "c", "d"))]
    unknown = np.full((len(recordings[0].imu), 3), np.nan)
    tracks = [Track(r.name, r.imu, r.bias_at(r.imu.t_ns), unknown) for r in recordings]
    return Lessons(tracks[:2], tracks[2:], cut(recordings[2:], 30.0), TrainingConfig(epochs=1, mount_deg=0.0), seed=1)


def test_increments_are_those_of_preintegration():
    samples = recording("r", 3, seconds=3.0).imu
    edges = np.rint(np.array([-0.5, STEP - 0.5]) / 51.2 * 1e9).astype(np.int64)
    found = preintegrate(samples, edges, np.zeros(3), np.zeros(3))
    values = torch.from_numpy(np.hstack([samples.gyro, samples.accel])[None, :STEP].astype(np.float32))
    R, v, p = integrate(values, 1.0 / 51.2)
    np.testing.assert_allclose(R[0], found.delta_R[0], atol=1e-4)
    np.testing.assert_allclose(v[0], found.delta_v[0], atol=1e-3)
    np.testing.assert_allclose(p[0], found.delta_p[0], atol=1e-3)


def test_the_true_correction_has_no_loss_and_any_axis_can_be_wrong():
    window = torch.randn(2, 2 * STEP, 6, generator=torch.Generator().manual_seed(1))
    assert increment_loss(window, window, 0.02).max() == 0.0
    for k in range(6):
        wrong = window.clone()
        wrong[..., k] += (0.05, 0.3)[k // 3]
        loss = increment_loss(wrong, window, 0.02)
        assert loss.min() > 0.1


def test_the_recursion_lives_on_what_it_said():
    torch.manual_seed(1)
    network = Recursive(torch.full((6,), 0.1), torch.full((6,), 0.5)).eval()
    torch.nn.init.normal_(network.step.out.weight, std=0.1)
    window = torch.randn(1, CONFIG.samples, 6)
    found = network.estimates(window)
    assert len(found) == CONFIG.samples // STEP
    bias, _ = network.step(window[:, STEP : 2 * STEP], found[0][0])
    torch.testing.assert_close(bias, found[1][0])
    network.train()
    assert not torch.equal(network.estimates(window)[0][0], found[0][0])  # starts are wrong on purpose


def test_what_runs_is_what_was_trained(lessons, tmp_path, monkeypatch):
    kept = []
    monkeypatch.setattr("ipnet.rivals.learning.train", lambda network, *_, **__: kept.append(shaken(network)))
    learn_recursive(lessons, tmp_path / "r")
    learn_corrector(lessons, tmp_path / "c")
    recursive, corrector = kept
    samples = recording("e", 9).imu
    values = torch.from_numpy(np.hstack([samples.gyro, samples.accel])[None].astype(np.float32))
    window = values[:, : CONFIG.samples]
    with torch.no_grad():
        expected = {"recursive": recursive(window)[0], "corrector": corrector(window)[0]}
    for name, folder, index in (("recursive", "r", 7), ("corrector", "c", 0)):
        source = load_prior(f"{name}:{tmp_path / folder}")
        assert source.device() is None
        source.add_imu(samples)
        z = source.poll(int(samples.t_ns[-1]))[index]
        np.testing.assert_allclose(z.vector, expected[name][0], atol=1e-5)
        assert np.linalg.eigvalsh(source.constant_covariance).min() > 0.0


def test_a_memory_is_no_surer_than_the_device_prior_where_few_recordings_calibrate(lessons, tmp_path, monkeypatch):
    monkeypatch.setattr(learning, "train", lambda network, *_, **__: shaken(network))
    learn_recursive(lessons, tmp_path)
    card = RivalCard.read(tmp_path)
    labels = [Label(t.name, t.bias.mean(axis=0), np.eye(6)) for t in lessons.training]
    few = calibrate(lessons, tmp_path, card)
    monkeypatch.setattr(assessment, "FEW", len(lessons.validation))
    many = calibrate(lessons, tmp_path, card)
    np.testing.assert_allclose(few.constant - many.constant, learn(labels).covariance, atol=1e-12)
    np.testing.assert_array_equal(card.errors.constant, few.constant)


def test_a_recording_in_more_runs_is_not_more_recordings(lessons, tmp_path, monkeypatch):
    """A memory's error is the same in all runs of a recording: told thrice, it is no surer."""
    monkeypatch.setattr(learning, "train", lambda network, *_, **__: shaken(network))
    learn_corrector(lessons, tmp_path)
    card = RivalCard.read(tmp_path)
    once, thrice = (
        calibrate(lessons, tmp_path, card),
        calibrate(replace(lessons, spans=3 * lessons.spans), tmp_path, card),
    )
    np.testing.assert_allclose(thrice.constant, once.constant, rtol=1e-6)


def test_one_validation_recording_is_enough(lessons, tmp_path, monkeypatch):
    monkeypatch.setattr(learning, "train", lambda network, *_, **__: shaken(network))
    lessons = replace(lessons, validation=lessons.validation[:1], spans=lessons.spans[:1])
    learn_corrector(lessons, tmp_path)
    constant = RivalCard.read(tmp_path).errors.constant
    labels = [Label(t.name, t.bias.mean(axis=0), np.eye(6)) for t in lessons.training]
    assert np.linalg.eigvalsh(constant - learn(labels).covariance).min() > 0.0


def test_both_train(lessons, tmp_path):
    for teach in (learn_recursive, learn_corrector):
        out = tmp_path / teach.__name__
        teach(lessons, out)
        assert (out / "card.json").is_file()
        assert (out / "log" / "csv" / "version_0" / "metrics.csv").read_text().count("\n") >= 2


def test_an_unknown_name_is_answered_with_the_list():
    for name in ("recursive", "corrector"):
        with pytest.raises(ConfigError, match=f"{name} 'balloon' is unknown; known are"):
            load_prior(f"{name}:balloon")


def shaken(network):
    """A network whose outputs depend on its inputs."""
    for parameter in network.parameters():
        torch.nn.init.normal_(parameter, std=0.1)
    return network.eval()


def test_the_corrector_corrects_every_sample():
    network = shaken(Corrector(torch.zeros(6)))
    window = torch.randn(2, CONFIG.samples, 6)
    correction = network.correction(window)
    assert correction.shape == window.shape
    torch.testing.assert_close(network(window)[0], correction.mean(1))


def test_what_is_missing_is_said(lessons, tmp_path, monkeypatch):
    monkeypatch.setattr(learning, "train", lambda network, *_, **__: shaken(network))
    learn_corrector(lessons, tmp_path)
    (tmp_path / "network.onnx").unlink()
    with pytest.raises(ConfigError, match=r"network\.onnx: no such file"):
        load_prior(f"corrector:{tmp_path}")
    (tmp_path / "card.json").write_text("{}")
    with pytest.raises(ConfigError, match=r"card\.json: KeyError\('grid'\); expected what"):
        load_prior(f"corrector:{tmp_path}")


def test_what_is_learned_from_does_not_judge(lessons, tmp_path, monkeypatch):
    monkeypatch.setattr(learning, "open_tracks", lambda paths, *_: lessons.training)
    with pytest.raises(LabelError, match="a, b: learned from and validated on"):
        Lessons.read([], [], None, tmp_path, 1, 1)
