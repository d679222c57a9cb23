"""Files of labels, as `ipnet.recordings.read_labels` reads them."""

import json
from collections.abc import Iterable
from pathlib import Path

from ipnet.recordings import Label


def write_labels(path: Path, labels: Iterable[Label]) -> None:
    """Write a list of labels; the file appears whole or not."""
    rows = [
        {
            "sequence": x.sequence,
            "b_g": x.bias[:3].tolist(),
            "b_a": x.bias[3:].tolist(),
            "covariance": x.covariance.tolist(),
        }
        for x in labels
    ]
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(path.name + ".partial")
    partial.write_text(json.dumps(rows, indent=1, allow_nan=False), encoding="utf-8")
    partial.replace(path)
