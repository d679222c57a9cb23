"""Exported networks on recordings that they were not trained on: how wrong they are, and how wrong they say."""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ipnet import device
from ipnet.calibration import ErrorModel, WindowErrors, fit
from ipnet.dataset import Track
from ipnet.errors import LabelError
from ipnet.network_source import ONNX, Network, in_body
from ipnet.recordings import Label
from ipnet.weights import Card, NetworkCard
from ipnet.windows import WindowStream
from navcore.arrays import Rotations

FEW = 12
"""Fewer validation recordings show nothing of what their device's biases do from day to day."""


def calibrate(folder: Path, card: Card, tracks: Iterable[Track], training: Iterable[Track]) -> Card:
    """The card with the error models and figures of its networks on recordings.

    Args:
        folder: of the exported networks.
        card: theirs.
        tracks: recordings that they were not trained on.
        training: those that they were trained on: a network that is not `centred` can remember their device.

    Raises:
        LabelError: none is as long as a window.
        ConfigError: fewer than two recordings that a network can remember.
    """
    tracks, training = list(tracks), list(training)
    networks = {}
    for name, network in card.networks.items():
        exported = Network(folder / f"{name}{ONNX}")
        errors = [e for e in (window_errors(exported, network, track) for track in tracks) if len(e.t_ns)]
        if not errors:
            raise LabelError(f"{len(tracks)} recordings to calibrate on; none is as long as a window of {name}")
        model = fitted(errors, network.grid.seconds)
        if not network.config.centred:
            R_NB = exported(np.ones((network.config.samples, 6))).R_NB
            model = remembered(model, len({e.recording for e in errors}), training, R_NB)
        networks[name] = replace(network, errors=model, validation=figures(errors, model))
    return replace(card, networks=networks)


def fitted(errors: list[WindowErrors], window_s: float) -> ErrorModel:
    """To runs of several recordings, or of one.

    One cannot tell what is constant over a run: that is half of the mean square error then.
    """
    if len({e.recording for e in errors}) > 1:
        return fit(errors, window_s)
    square = np.vstack([e.error**2 for e in errors]).mean(axis=0)
    stated = np.vstack([e.variance for e in errors]).mean(axis=0)
    return ErrorModel(np.diag(0.5 * square), np.sqrt(0.5 * square / stated), np.zeros(6))


def remembered(model: ErrorModel, recordings: int, training: Iterable[Track], R_NB: Rotations) -> ErrorModel:
    """The error model of a network that can remember its device.

    How wrong a memory is shows on other days, and few recordings are often of the same. So if fewer than `FEW` of them
    gave the model, the constant error is widened by what the training recordings allow for the device's next one.

    Args:
        model: of those recordings, in the network's frame.
        recordings: how many they are.
        training: those that the network was trained on.
        R_NB: (3, 3) to the network's frame; where the mount may be any, only the mean over axes counts, in any frame.

    Raises:
        ConfigError: fewer than two training recordings.
    """
    if recordings >= FEW:
        return model
    labels = [Label(t.name, t.bias.mean(axis=0), 1e-12 * np.eye(6)) for t in training]
    return replace(model, constant=model.constant + in_body(device.learn(labels).covariance, R_NB.T))


def window_errors(network: Network, card: NetworkCard, track: Track) -> WindowErrors:
    """Errors of a network on all windows of a recording, in the network's frame."""
    stamps, errors, variances = [], [], []
    for window in WindowStream(card.grid).add(track.imu):
        said = network(window.values)
        error = said.bias - track.bias[np.searchsorted(track.imu.t_ns, window.middle_ns)]
        stamps.append(window.middle_ns)
        errors.append((error.reshape(2, 3) @ said.R_NB.T).reshape(6))
        variances.append(said.variance)
    n = len(stamps)
    rows = np.array(stamps, dtype=np.int64), np.reshape(errors, (n, 6)), np.reshape(variances, (n, 6))
    return WindowErrors(track.name, *rows)


def figures(errors: list[WindowErrors], model: ErrorModel) -> dict[str, Any]:
    """Per axis, over windows: root mean square and median of errors, and the share inside 90 % intervals."""
    error = np.vstack([e.error for e in errors])
    variance = model.variance(np.vstack([e.variance for e in errors])) + np.diagonal(model.constant)
    inside = np.abs(error) <= 1.645 * np.sqrt(variance)
    return {
        "recordings": len(errors),
        "windows": len(error),
        "rmse": np.sqrt((error**2).mean(axis=0)).tolist(),
        "median": np.median(np.abs(error), axis=0).tolist(),
        "coverage_90": inside.mean(axis=0).tolist(),
    }
