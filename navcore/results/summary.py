"""The figures of a run that need no truth: how complete it is, when it started, what it cost, what it met."""

import re
import resource
from collections import Counter
from typing import Any

import numpy as np

from navcore.arrays import Floats
from navcore.odometry import SKIPPED, Estimate, Health, Run
from navcore.sequence import Sequence

DECODING = "decode"
"""Name of the stage that reads and decodes images; it is listed, but not part of the total."""

_NUMBER = re.compile(r"\d+(\.\d+)?")


def summarise(run: Run, sequence: Sequence) -> dict[str, Any]:
    """Figures of a run over a recording.

    Returns:
        `frames`; `completeness`, the share of the recording's frames that have a pose; `start_s` from the
        first frame to the first pose, None without one; `cpu_ms_per_frame` with `mean`, `median` and the same
        by stage under `stages` (decoding is a stage, but not in the total); `peak_rss_mb` of this process;
        `health`, frames by health; `reasons`, frames by reason, its numbers as N; `skipped_frames`, by stamp
        and reason; `notes` of the reader.
    """
    frames = max(len(sequence.frames), len(run.estimates))
    reasons = [(e.t_ns, reason) for e in run.estimates for reason in dict.fromkeys(e.reasons)]
    return {
        "frames": frames,
        "completeness": int(run.has_state.sum()) / frames if frames else 0.0,
        "start_s": _start(run, sequence),
        "cpu_ms_per_frame": _cost(run.estimates),
        "peak_rss_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0,
        "health": {h.value: sum(e.health is h for e in run.estimates) for h in Health},
        "reasons": dict(Counter(_kind(reason) for _, reason in reasons).most_common()),
        "skipped_frames": [f"{t_ns} ns: {reason}" for t_ns, reason in reasons if reason.startswith(SKIPPED)],
        "notes": list(sequence.notes),
    }


def _kind(reason: str) -> str:
    """A reason without what differs from frame to frame: its details, and its numbers."""
    return _NUMBER.sub("N", reason.partition(":")[0])


def _start(run: Run, sequence: Sequence) -> float | None:
    """Seconds from the first frame, in IMU time, to the first pose."""
    first_pose = next((e.t_ns for e in run.estimates if e.state is not None), None)
    if first_pose is None or not sequence.frames:
        return None
    cameras = sequence.calibration.cameras
    offset_ns = round(cameras[0].dt_cam_imu * 1e9) if cameras else 0
    return (first_pose - sequence.frames[0].t_ns - offset_ns) * 1e-9


def _cost(estimates: tuple[Estimate, ...]) -> dict[str, Any]:
    """Mean and median CPU time a frame [ms], in total and by stage."""
    stages = list(dict.fromkeys(stage for e in estimates for stage in e.stages))
    times: Floats = np.array([[1e3 * e.stages.get(stage, 0.0) for stage in stages] for e in estimates])
    times = times.reshape(len(estimates), len(stages))
    counted = [k for k, stage in enumerate(stages) if stage != DECODING]
    by_stage = {stage: _middle(times[:, k]) for k, stage in enumerate(stages)}
    return {**_middle(times[:, counted].sum(axis=1)), "stages": by_stage}


def _middle(times: Floats) -> dict[str, float]:
    if times.size == 0:
        return {"mean": 0.0, "median": 0.0}
    return {"mean": float(times.mean()), "median": float(np.median(times))}
