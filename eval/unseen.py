"""What can be told of the biases of a public recording by sources that were made without it."""

from pathlib import Path

from eval.arms import Sources
from eval.kept import kept
from ipnet.device import learn
from ipnet.errors import ConfigError
from ipnet.recordings import PUBLIC_LABELS, read_labels
from ipnet.seen import seen_by
from ipnet.splits import unseen_split

_WINDOW_S = 5


def unseen_sources(recording: str, workspace: Path, truth: bool) -> tuple[Sources, tuple[str, ...]] | None:
    """The sources of the first split that has not seen a recording, and those that it has not; None if there is no such
    split, or the name is none of a public recording.

    The device's memory is what the labels of the split's training recordings say of it.

    Args:
        recording: its name.
        workspace: the study's folder, where the file of the prior `constant` is put.
        truth: whether the recording's truth knows the biases.
    """
    split = unseen_split(recording)
    if split is None:
        return None
    name, parts = split
    labels = read_labels(PUBLIC_LABELS)
    memory = workspace / f"device-{name}.json"
    workspace.mkdir(parents=True, exist_ok=True)
    learn([labels[trained] for trained in parts.train]).write(memory)
    specs = {
        "window_mean": f"window-mean:{name}-{_WINDOW_S}",
        "ipnet": f"ipnet:{name}",
        "motion": f"motion:{name}",
        "joined": f"ipnet+motion:{name}",
        "recursive": f"recursive:{name}",
    }
    there = {kind: spec if _made_without(recording, spec) else None for kind, spec in specs.items()}
    missing = tuple(spec for kind, spec in specs.items() if there[kind] is None)
    return Sources(constant=kept(f"constant:{memory}", workspace), **there, truth=truth), missing


def _made_without(recording: str, spec: str) -> bool:
    """Whether there is a source of that name, and it has not seen the recording."""
    try:
        return recording not in seen_by(spec)
    except ConfigError:
        return False
