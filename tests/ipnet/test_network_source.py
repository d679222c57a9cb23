"""Weights in a folder as a source of priors: parity, causality, order, names, files."""

import csv
import sys
from dataclasses import replace
from subprocess import run

import numpy as np
import pytest
import torch

from ipnet.assessment import calibrate, figures, fitted
from ipnet.calibration import ErrorModel, WindowErrors
from ipnet.device import learn
from ipnet.errors import ConfigError
from ipnet.export import ONNX, SAFETENSORS, export, export_folder, load, save
from ipnet.model import IPNet
from ipnet.network_source import Network, NetworkPrior, make
from ipnet.prediction import predict
from ipnet.recordings import Label
from ipnet.training import begin
from ipnet.weights import Card, NetworkCard, find, names
from ipnet.windows import WindowStream
from navcore.calibration import Calibration
from navcore.imu import ImuNoise
from navcore.prior import load_prior
from navcore.sequence import Sequence
from tests.ipnet.flying import SMALL, flight

SHORT = replace(SMALL, samples=64, rate_hz=32.0)  # 2 s
FLIGHT = flight(7, seconds=25.0)
ERRORS = {
    "short": ErrorModel(np.diag(np.repeat([1e-4, 1e-2], 3)), np.full(6, 2.0), np.full(6, 1e-3)),
    "long": ErrorModel(np.diag(np.repeat([1e-6, 1e-3], 3)), np.ones(6), np.zeros(6)),
}


@pytest.fixture(scope="module")
def weights(tmp_path_factory):
    folder = tmp_path_factory.mktemp("weights")
    tracks = [flight(k) for k in range(2)]
    shapes = {"short": (SHORT, 2.0), "long": (SMALL, 4.0)}
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


@pytest.mark.parametrize("name", ["short", "long"])
def test_the_exported_network_says_the_same(weights, name):
    card = Card.read(weights).networks[name]
    network, exported = load(weights / f"{name}{SAFETENSORS}", card.config), Network(weights / f"{name}{ONNX}")
    for window in WindowStream(card.grid).add(FLIGHT.imu):
        with torch.no_grad():
            bias, scale = network(torch.from_numpy(window.values[None].astype(np.float32)))
        found, variance = exported(window)
        np.testing.assert_allclose(found, bias[0], atol=1e-5)
        np.testing.assert_allclose(variance, 2.0 * scale[0] ** 2, rtol=1e-3)


def test_chunks_do_not_matter_and_the_future_is_unknown(weights):
    whole = rows(said(weights, FLIGHT.imu, len(FLIGHT.imu)))
    np.testing.assert_allclose(rows(said(weights, FLIGHT.imu, 37)), whole, rtol=1e-4, atol=1e-7)
    early = rows(said(weights, FLIGHT.imu[: len(FLIGHT.imu) // 2], 37))
    np.testing.assert_allclose(early, whole[: len(early)], rtol=1e-4, atol=1e-7)
    assert 0 < len(early) < len(whole)


def test_the_same_input_gives_the_same_bits(weights):
    np.testing.assert_array_equal(rows(said(weights, FLIGHT.imu, 50)), rows(said(weights, FLIGHT.imu, 50)))


def test_the_short_network_speaks_until_the_middle_of_the_long_ones_first_window(weights):
    found = said(weights, FLIGHT.imu, 100)
    source = make(str(weights), None)
    begin = FLIGHT.imu.t_ns[0] * 1e-9
    np.testing.assert_allclose([z.t_ns * 1e-9 - begin for z in found], [1.0, 4.0, 8.0, 12.0, 16.0, 20.0], atol=0.01)
    assert np.diff([z.t_ns for z in found]).min() * 1e-9 >= source.window_s - 1e-3
    np.testing.assert_array_equal(source.constant_covariance, ERRORS["long"].constant)
    assert source.device() is None


def test_overlapping_windows_count_for_what_is_new(weights):
    card = Card.read(weights).networks["long"]
    alone = [
        np.diag(card.errors.variance(Network(weights / f"long{ONNX}")(w)[1]))
        for w in WindowStream(card.grid).add(FLIGHT.imu)
    ]
    long = said(weights, FLIGHT.imu, 100)[1:]
    np.testing.assert_allclose(long[0].covariance, alone[0], rtol=1e-6)
    np.testing.assert_allclose(long[1].covariance, 2.0 * alone[1], rtol=1e-6)


def test_what_the_short_network_has_more_of_constant_error_is_in_its_noise(weights):
    first = said(weights, FLIGHT.imu, 100)[0]
    more = np.diagonal(ERRORS["short"].constant) - np.diagonal(ERRORS["long"].constant)
    assert (np.diagonal(first.covariance) > more).all()


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
    export(IPNet(replace(SHORT, reach=())), tmp_path / "x.onnx")
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
        shape = replace(SHORT, centred=centred, reach=())
        export(IPNet(shape), tmp_path / f"short{ONNX}")
        card = Card({"short": NetworkCard(shape, 2.0, ERRORS["short"])}, (), (), {})
        found = calibrate(tmp_path, card, tracks[3:], tracks[:3]).networks["short"].errors
        card = replace(card, networks={"short": replace(card.networks["short"], config=replace(shape, centred=True))})
        taken_at_its_word = calibrate(tmp_path, card, tracks[3:], tracks[:3]).networks["short"].errors
        wider = np.zeros((6, 6)) if centred else learn(biases).covariance
        np.testing.assert_allclose(found.constant - taken_at_its_word.constant, wider, atol=1e-12)
