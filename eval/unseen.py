"""What can be told of the biases of a public recording by sources that were made without it."""

from pathlib import Path

from eval.arms import Sources, write_constant
from ipnet.device import learn
from ipnet.errors import ConfigError
from ipnet.recordings import PUBLIC_LABELS, read_labels
from ipnet.seen import seen_by
from ipnet.splits import SPLITS

_WINDOW_S = 5


def unseen_sources(recording: str, workspace: Path, truth: bool) -> Sources | None:
    """The sources of the first split that tests on a recording; None if none does.

    The device's memory is what the labels of the split's other recordings say of it.

    Args:
        recording: its name.
        workspace: the study's folder, where the file of the prior `constant` is put.
        truth: whether the recording's truth knows the biases.
    """
    split = next((name for name, parts in SPLITS.items() if recording in parts.test), None)
    if split is None:
        return None
    labels = read_labels(PUBLIC_LABELS)
    device = learn([labels[name] for name in SPLITS[split].train])
    return Sources(
        constant=f"constant:{write_constant(workspace, device.mean, device.covariance)}",
        window_mean=_unless_seen(recording, f"window-mean:{split}-{_WINDOW_S}"),
        ipnet=_unless_seen(recording, f"ipnet:{split}"),
        motion=_unless_seen(recording, f"motion:{split}"),
        joined=_unless_seen(recording, f"ipnet+motion:{split}"),
        recursive=_unless_seen(recording, f"recursive:{split}"),
        truth=truth,
    )


def _unless_seen(recording: str, spec: str) -> str | None:
    """The source, if there is one of that name and it has not seen the recording."""
    try:
        return None if recording in seen_by(spec) else spec
    except ConfigError:
        return None
