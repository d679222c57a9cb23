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
from ipnet.recordings import Recording
from ipnet.runs import Span, cut, listen
from navcore.imu import ImuNoise

Progress = Callable[[int, int], None]
"""Gets the number of recordings done and of all."""
_SPAN_S = 62.0  # runs by which errors are found: long enough for the longest window
_MANY = 12  # recordings that suffice to find errors by
_PLAIN = ErrorModel(np.zeros((6, 6)), np.ones(6), np.zeros(6))


def learn(
    training: ListLike[Recording], validation: ListLike[Recording] = (), progress: Progress | None = None
) -> MotionCard:
    """A model of the training recordings, and what is wrong with its statements.

    That is found on the validation recordings and, where there are fewer than 12 of them, on the training recordings
    too, each by a model of all others.

    Raises:
        LabelError: fewer than three recordings to learn from, or too little motion in them.
    """
    if len(training) < 3:
        raise LabelError(f"{len(training)} recordings to learn from; expected three or more")
    plain = _card(training)
    left_out = list(training) if len(validation) < _MANY else []
    judges = [(plain, recording) for recording in validation]
    judges += [(replace(_card([r for r in training if r is not own]), R_FB=plain.R_FB), own) for own in left_out]
    errors = []
    for done, (card, recording) in enumerate(judges, 1):
        errors += [_errors(card, span) for span in _spans(recording)]
        if progress is not None:
            progress(done, len(judges))
    found = fit_errors(errors, MotionPrior(plain, plain.noise).window_s)
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


def _spans(recording: Recording) -> list[Span]:
    seconds = (recording.imu.t_ns[-1] - recording.imu.t_ns[0]) * 1e-9
    return cut([recording], _SPAN_S if seconds >= _SPAN_S else None)


def _errors(card: MotionCard, span: Span) -> WindowErrors:
    """In the card's axes."""
    said = listen(MotionPrior(card, span.noise), span).measurements
    t_ns = np.array([z.t_ns for z in said], dtype=np.int64)
    wrong = np.array([z.vector for z in said]).reshape(-1, 6) - span.bias_at(t_ns)
    variance = [np.diagonal(card.R6 @ z.covariance @ card.R6.T) for z in said]
    return WindowErrors(span.recording, t_ns, wrong @ card.R6.T, np.array(variance).reshape(-1, 6))
