"""From recordings to a motion model that knows how wrong its statements are."""

from collections.abc import Callable
from collections.abc import Sequence as ListLike
from dataclasses import replace

import numpy as np

from ipnet.calibration import ErrorModel, WindowErrors
from ipnet.calibration import fit as fit_errors
from ipnet.directions import along_first
from ipnet.errors import LabelError
from ipnet.motion.fit import fit
from ipnet.motion.source import MotionPrior
from ipnet.motion.store import MotionCard
from ipnet.recordings import Recording, kept_apart
from ipnet.runs import Span, cut, listen
from navcore.arrays import Floats
from navcore.imu import ImuNoise

Progress = Callable[[int, int], None]
"""Gets the number of recordings done and of all."""
_SPANS_S = (42.0, 62.0)  # lengths of the runs by which errors are found: with growing windows, and with sliding ones
_MANY = 12  # recordings that suffice to find errors by
_PLAIN = ErrorModel(np.zeros((6, 6)), np.ones(6), np.zeros(6))


def learn(
    training: ListLike[Recording], validation: ListLike[Recording] = (), progress: Progress | None = None
) -> MotionCard:
    """A model of the training recordings, and what is wrong with its statements.

    That is found on the validation recordings and, where there are fewer than 12 of them, on the training recordings
    too, each by a model of all others. What is held against the truth is what the last window of a run knows: all that
    is told of a run leads there.

    Raises:
        LabelError: fewer than three recordings to learn from, or too little motion in them, or some validate too.
    """
    if len(training) < 3:
        raise LabelError(f"{len(training)} recordings to learn from; expected three or more")
    kept_apart((r.name for r in training), (r.name for r in validation))
    plain = _card(training)
    left_out = list(training) if len(validation) < _MANY else []
    judges = [(plain, recording) for recording in validation]
    judges += [(replace(_card([r for r in training if r is not own]), R_FB=plain.R_FB), own) for own in left_out]
    errors = []
    for done, (card, recording) in enumerate(judges, 1):
        errors += [_errors(card, recording, seconds) for seconds in _SPANS_S]
        if progress is not None:
            progress(done, len(judges))
    found = fit_errors(errors, 0.0, floors=False)
    return replace(plain, errors=found, validation=tuple(recording.name for _, recording in judges))


def _card(recordings: ListLike[Recording]) -> MotionCard:
    """A model that takes the smoother at its word."""
    model = fit(recordings)
    force = np.sum([r.imu.accel.mean(axis=0) - r.label.bias[3:] for r in recordings], axis=0)
    noise = ImuNoise(*np.median([list(vars(r.noise).values()) for r in recordings], axis=0).tolist())
    R_FB = along_first(force / np.linalg.norm(force))
    names = tuple(r.name for r in recordings)
    made = {"recordings": len(recordings), "interval_s": model.interval_s}
    return MotionCard(model, noise, R_FB, _PLAIN, names, (), made)


def _errors(card: MotionCard, recording: Recording, seconds: float) -> WindowErrors:
    """Of what is known at the end of runs of about that length, in the card's axes; one row for each."""
    whole = float(recording.imu.t_ns[-1] - recording.imu.t_ns[0]) * 1e-9
    spans = cut([recording], seconds if whole >= seconds else None)
    rows = {span.end_ns: row for span in spans if (row := _over_run(card, span)) is not None}
    error, variance = (np.array([row[k] for row in rows.values()]).reshape(-1, 6) for k in (0, 1))
    return WindowErrors(recording.name, np.array(list(rows), dtype=np.int64), error, variance)


def _over_run(card: MotionCard, span: Span) -> tuple[Floats, Floats] | None:
    """(6,) error and stated variance of what is known when the last window of a run ends; None without any."""
    source = MotionPrior(card, span.noise)
    listen(source, span)
    if source.known is None:
        return None
    t_ns = np.array([source.known.t_ns], dtype=np.int64)
    error = card.R6 @ (source.known.mean - span.bias_at(t_ns)[0])
    return error, np.diagonal(card.R6 @ source.known.covariance @ card.R6.T)
