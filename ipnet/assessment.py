"""Exported networks on recordings that they were not trained on: how wrong they are, and how wrong they say."""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ipnet.calibration import ErrorModel, WindowErrors, fit
from ipnet.dataset import Track
from ipnet.errors import LabelError
from ipnet.network_source import ONNX, Network
from ipnet.weights import Card, NetworkCard
from ipnet.windows import WindowStream


def calibrate(folder: Path, card: Card, tracks: Iterable[Track]) -> Card:
    """The card with the error models and figures of its networks on recordings.

    Raises:
        LabelError: none is as long as a window.
    """
    tracks = list(tracks)
    networks = {}
    for name, network in card.networks.items():
        exported = Network(folder / f"{name}{ONNX}")
        errors = [e for e in (window_errors(exported, network, track) for track in tracks) if len(e.t_ns)]
        if not errors:
            raise LabelError(f"{len(tracks)} recordings to calibrate on; none is as long as a window of {name}")
        model = fit(errors, network.grid.seconds) if len(errors) > 1 else half_and_half(errors[0])
        networks[name] = replace(network, errors=model, validation=figures(errors, model))
    return replace(card, networks=networks)


def half_and_half(errors: WindowErrors) -> ErrorModel:
    """From one recording, which cannot tell what is constant over a run: half of the mean square error."""
    square = (errors.error**2).mean(axis=0)
    return ErrorModel(np.diag(0.5 * square), np.sqrt(0.5 * square / errors.variance.mean(axis=0)), np.zeros(6))


def window_errors(network: Network, card: NetworkCard, track: Track) -> WindowErrors:
    """Errors of a network on all windows of a recording."""
    stamps, errors, variances = [], [], []
    for window in WindowStream(card.grid).add(track.imu):
        bias, variance = network(window)
        truth = track.bias[np.searchsorted(track.imu.t_ns, window.middle_ns)]
        stamps.append(window.middle_ns)
        errors.append(bias - truth)
        variances.append(variance)
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
