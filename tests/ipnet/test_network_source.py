"""Weights in a folder as a source of priors: parity, causality, order, names, files."""

import csv
import sys
from dataclasses import replace
from pathlib import Path
from subprocess import run

import numpy as np
import pytest
import torch

from ipnet import project
from ipnet.assessment import calibrate, figures, fitted
from ipnet.calibration import ErrorModel, WindowErrors
from ipnet.device import learn
from ipnet.errors import ConfigError, LabelError
from ipnet.export import ONNX, SAFETENSORS, export, export_folder, load, save
from ipnet.model import IPNet
from ipnet.network_source import Network, NetworkPrior, in_body, make
from ipnet.prediction import predict
from ipnet.recordings import Label
from ipnet.training import begin
from ipnet.weights import Card, NetworkCard, find, names
from ipnet.windows import WindowStream, joined
from navcore import so3
from navcore.calibration import Calibration
from navcore.imu import ImuNoise
from navcore.prior import load_prior
from navcore.sequence import Sequence
from tests.ipnet.flying import SMALL, flight

SHORT = replace(SMALL, samples=64, rate_hz=32.0)  # 2 s
MEDIUM = replace(SMALL, samples=96)  # 4 s
FLIGHT = flight(7, seconds=25.0)
ERRORS = {
    "short": ErrorModel(np.diag(np.repeat([1e-4, 1e-2], 3)), np.full(6, 2.0), np.full(6, 1e-3)),
    "medium": ErrorModel(np.diag(np.repeat([1e-5, 2e-3], 3)), np.ones(6), np.zeros(6)),
    "long": ErrorModel(np.diag(np.repeat([1e-6, 1e-3], 3)), np.ones(6), np.zeros(6)),
}


@pytest.fixture(scope="module")
def weights(tmp_path_factory):
    folder = tmp_path_factory.mktemp("weights")
    tracks = [flight(k) for k in range(2)]
    shapes = {"short": (SHORT, 2.0), "medium": (MEDIUM, 1.0), "long": (SMALL, 4.0)}
    for name, (shape, _) in shapes.items():
        torch.manual_seed(1)
        network = IPNet(shape)
        begin(network, tracks, 0.0, np.random.default_rng(1))
        save(network, folder / f"{name}{SAFETENSORS}")
    cards = {name: NetworkCard(shape, every_s, ERRORS[name]) for name, (shape, every_s) in shapes.items()}
    Card(cards, ("a",), ("b",), {"seed": 1}).write(folder)
    export_folder(folder)
    return folder


def said(folder, imu, chunk):
    source = make(str(folder), None)
    found = []
    for k in range(0, len(imu), chunk):
        part = imu[k : k + chunk]
        source.add_imu(part)
        found += source.poll(int(part.t_ns[-1]))
    return found


def rows(found):
    return np.array([[z.t_ns * 1e-9, *z.vector, *np.diagonal(z.covariance)] for z in found])


@pytest.mark.parametrize("name", ["short", "medium", "long"])
def test_the_exported_network_says_the_same(weights, name):
    card = Card.read(weights).networks[name]
    network, exported = load(weights / f"{name}{SAFETENSORS}", card.config), Network(weights / f"{name}{ONNX}")
    for window in WindowStream(card.grid).add(FLIGHT.imu):
        with torch.no_grad():
            bias, scale, R = network(torch.from_numpy(window.values[None].astype(np.float32)))
        said = exported(window.values)
        np.testing.assert_allclose(said.bias, bias[0], atol=1e-5)
        np.testing.assert_allclose(said.variance, 2.0 * scale[0] ** 2, rtol=1e-3)
        np.testing.assert_allclose(said.R_NB, R[0], atol=1e-6)


def test_chunks_do_not_matter_and_the_future_is_unknown(weights):
    whole = rows(said(weights, FLIGHT.imu, len(FLIGHT.imu)))
    np.testing.assert_allclose(rows(said(weights, FLIGHT.imu, 37)), whole, rtol=1e-4, atol=1e-7)
    early = rows(said(weights, FLIGHT.imu[: len(FLIGHT.imu) // 2], 37))
    np.testing.assert_allclose(early, whole[: len(early)], rtol=1e-4, atol=1e-7)
    assert 0 < len(early) < len(whole)


def test_the_same_input_gives_the_same_bits(weights):
    np.testing.assert_array_equal(rows(said(weights, FLIGHT.imu, 50)), rows(said(weights, FLIGHT.imu, 50)))


def test_each_network_speaks_until_the_middle_of_the_next_ones_first_window(weights):
    found = said(weights, FLIGHT.imu, 100)
    source = make(str(weights), None)
    begin = FLIGHT.imu.t_ns[0] * 1e-9
    stamps = np.array([z.t_ns * 1e-9 - begin for z in found])
    np.testing.assert_allclose(stamps, [1.0, 2.0, 3.0, 4.0, 8.0, 12.0, 16.0, 20.0], atol=0.01)
    assert np.diff(stamps).min() >= source.window_s - 1e-3
    assert source.device() is None


def test_a_network_alone_loses_no_statement_to_its_overlaps(weights, tmp_path):
    """Windows of 8 s every 2 s bear their overlap themselves: a consumer that thins by `window_s` must keep all."""
    card = Card.read(weights)
    replace(card, networks={"long": replace(card.networks["long"], every_s=2.0)}).write(tmp_path)
    (tmp_path / f"long{ONNX}").write_bytes((weights / f"long{ONNX}").read_bytes())
    assert make(str(tmp_path), None).window_s == 2.0


def test_after_a_gap_all_begin_anew(weights):
    gap = FLIGHT.imu[: len(FLIGHT.imu) // 2]
    later = replace(FLIGHT.imu, t_ns=FLIGHT.imu.t_ns + round(60e9))
    found = said(weights, joined(gap, later), 100)
    stamps = np.array([(z.t_ns - later.t_ns[0]) * 1e-9 for z in found])
    np.testing.assert_allclose(stamps[stamps > 0.0], [1.0, 2.0, 3.0, 4.0, 8.0, 12.0, 16.0, 20.0], atol=0.01)


def alone(weights, name, more=0.0):
    """(windows, 6, 6) covariances of a network's own statements."""
    card, network = Card.read(weights).networks[name], Network(weights / f"{name}{ONNX}")
    each = [network(w.values) for w in WindowStream(card.grid).add(FLIGHT.imu)]
    return [in_body(np.diag(card.errors.variance(s.variance) + more), s.R_NB) for s in each]


def test_overlapping_windows_count_for_what_is_new(weights):
    long = said(weights, FLIGHT.imu, 100)[3:]
    first, second = alone(weights, "long")[:2]
    np.testing.assert_allclose(long[0].covariance, first, rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(long[1].covariance, 2.0 * second, rtol=1e-6, atol=1e-12)


def test_what_shorter_networks_have_more_of_constant_error_is_in_their_noise(weights):
    found = said(weights, FLIGHT.imu, 100)
    for k, name, times in ((0, "short", 1), (1, "medium", 2)):
        more = times * (np.diagonal(ERRORS[name].constant) - np.diagonal(ERRORS["long"].constant))
        np.testing.assert_allclose(found[k].covariance, alone(weights, name, more)[0], rtol=1e-6, atol=1e-12)


def test_covariances_turn_with_the_frame():
    R = so3.exp(np.array([0.3, -0.2, 0.9]))
    draws = np.random.default_rng(1).normal(size=(6, 4000)) * np.arange(1.0, 7.0)[:, None]
    turned = np.vstack([R.T @ draws[:3], R.T @ draws[3:]])
    np.testing.assert_allclose(in_body(draws @ draws.T, R), turned @ turned.T, rtol=1e-9, atol=1e-6)


@pytest.mark.parametrize("mount", ["fixed", "any"])
def test_the_constant_error_is_told_in_the_imus_frame(tmp_path, mount):
    torch.manual_seed(2)
    network = IPNet(replace(SHORT, mount=mount, pieces=()))
    network.R_NB.copy_(torch.from_numpy(so3.exp(np.array([0.4, 0.0, 0.0])).astype(np.float32)))
    export(network, tmp_path / f"long{ONNX}")
    constant = np.diag([1.0, 2.0, 3.0, 10.0, 20.0, 30.0])
    card = Card({"long": NetworkCard(network.config, 2.0, ErrorModel(constant, np.ones(6), np.zeros(6)))}, (), (), {})
    found = NetworkPrior(tmp_path, card).constant_covariance
    fixed = in_body(constant, network.R_NB.double().numpy())
    np.testing.assert_allclose(found, fixed if mount == "fixed" else np.diag([2.0] * 3 + [20.0] * 3), atol=1e-5)


def test_an_unknown_name_is_answered_with_the_known():
    with pytest.raises(ConfigError, match="weights 'best' are unknown; known are"):
        load_prior("ipnet:best")


def test_shipped_weights_are_whole():
    assert names()
    for name in names():
        for network in Card.read(find(name)).networks:
            sizes = [(find(name) / f"{network}{kind}").stat().st_size for kind in (ONNX, SAFETENSORS)]
            assert 0 < max(sizes) <= 4e6
    assert isinstance(load_prior(f"ipnet:{names()[0]}"), NetworkPrior)


def test_other_weights_are_refused(weights):
    with pytest.raises(ConfigError, match="not the weights of"):
        load(weights / f"long{SAFETENSORS}", replace(SMALL, hidden=4))


def test_a_file_of_statements_is_a_prior(weights, tmp_path):
    sequence = Sequence("flight", Calibration(ImuNoise(1e-4, 0.0, 1e-3, 0.0), ()), FLIGHT.imu, (), None)
    count = predict(sequence, str(weights), tmp_path / "said.csv")
    with (tmp_path / "said.csv").open() as file:
        read = list(csv.reader(file))[1:]
    assert len(read) == count
    assert {len(row) for row in read} == {13}
    from_file = load_prior(f"file:{tmp_path / 'said.csv'}")
    assert len(from_file.poll(int(FLIGHT.imu.t_ns[-1]) + 10**11)) == count


def test_the_source_needs_no_torch():
    code = "import sys, ipnet.network_source; sys.exit('torch' in sys.modules)"
    assert run([sys.executable, "-c", code], check=False).returncode == 0


def test_export_replaces_whole_files(tmp_path):
    export(IPNet(replace(SHORT, pieces=())), tmp_path / "x.onnx")
    assert [p.name for p in tmp_path.iterdir()] == ["x.onnx"]


def test_one_recording_leaves_open_what_is_constant():
    rng = np.random.default_rng(1)
    errors = WindowErrors("a", np.arange(50), rng.normal(size=(50, 6)), np.full((50, 6), 4.0))
    model = fitted([errors], 1.0)
    total = model.variance(errors.variance).mean(axis=0) + np.diagonal(model.constant)
    np.testing.assert_allclose(total, (errors.error**2).mean(axis=0))
    assert figures([errors], model)["coverage_90"] == pytest.approx([0.9] * 6, abs=0.1)


def test_what_can_remember_a_device_is_no_surer_than_the_device_prior(tmp_path):
    """A network that is not centred can; one that is centred infers, and its errors are the same on any device."""
    tracks = [flight(k, seconds=16.0) for k in range(5)]
    biases = [Label(t.name, t.bias[0], np.eye(6)) for t in tracks[:3]]
    for centred in (True, False):
        network = IPNet(replace(SHORT, centred=centred, pieces=()))
        network.R_NB.copy_(torch.from_numpy(so3.exp(np.array([0.4, 0.0, 0.0])).astype(np.float32)))
        export(network, tmp_path / f"short{ONNX}")
        found = [
            calibrate(tmp_path, Card({"short": card}, (), (), {}), tracks[3:], tracks[:3]).networks["short"].errors
            for shape in (network.config, replace(network.config, centred=True))
            if (card := NetworkCard(shape, 2.0, ERRORS["short"]))
        ]
        wider = in_body(found[0].constant - found[1].constant, network.R_NB.double().numpy())
        np.testing.assert_allclose(wider, 0.0 if centred else learn(biases).covariance, atol=1e-9)


def test_a_card_without_its_network_is_told(tmp_path):
    Card({"long": NetworkCard(SMALL, 4.0, ERRORS["long"])}, (), (), {}).write(tmp_path)
    with pytest.raises(ConfigError, match=r"long\.onnx: no such file"):
        load_prior(f"ipnet:{tmp_path}")
    (tmp_path / "long.onnx").write_text("version https://git-lfs.github.com/spec/v1\n")
    with pytest.raises(ConfigError, match=r"long\.onnx: not a network"):
        load_prior(f"ipnet:{tmp_path}")


def test_what_is_learned_from_does_not_judge(weights, tmp_path, monkeypatch):
    monkeypatch.setattr(project, "open_tracks", lambda paths, *_: [flight(int(path.name)) for path in paths])
    with pytest.raises(LabelError, match="flight-2: learned from and validated on"):
        project.build(project.Project((Path("1"), Path("2")), (Path("2"),)), tmp_path)
    before = replace(Card.read(weights), training=("flight-3",))
    before.write(tmp_path)
    with pytest.raises(LabelError, match="flight-3: learned from and validated on"):
        project.build(project.Project((Path("1"),), (Path("3"),), start=str(tmp_path)), tmp_path)
