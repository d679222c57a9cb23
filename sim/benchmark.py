"""Any recording, degraded: one way of one's own, or all the ways of a benchmark."""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from navcore.readers import open_sequence
from navcore.sequence import Sequence
from sim.degrade import Schedule, degrade_sequence
from sim.degrade.spec import Spec
from sim.errors import ConfigError
from sim.output import Format, Progress, write_recording
from sim.output.folder import ORIGIN
from sim.output.recording import check_apart, check_request
from sim.streams import Streams


@dataclass(frozen=True)
class Plan:
    """What is to be written.

    Attributes:
        sequence: the recording as it is.
        jobs: by folder, the schedule and what is saved beside the recording as its origin.
        seed: of everything random.
        left_out: what does not fit the recording, a line each.
        done: folders that are there already, from the same origin.
    """

    sequence: Sequence
    jobs: Mapping[Path, tuple[Schedule, Mapping[str, object]]]
    seed: int
    left_out: tuple[str, ...] = ()
    done: tuple[Path, ...] = ()


def plan_one(recording: Path, degrade: str, seed: int, out: Path, format: Format = "asl") -> Plan:
    """One degraded copy of a recording.

    Raises:
        ConfigError: a bad schedule, one that reaches beyond the recording, or `out` is not empty or in the recording.
        DataError: no recording.
    """
    schedule = Schedule.parse(degrade)
    Streams.of(seed)
    check_apart(recording, out)
    sequence = _with_frames(recording)
    schedule.check(duration_s(sequence))
    origin = {**_identity(sequence), "degrade": str(schedule), "seed": seed}
    check_request(out, format, origin)
    return Plan(sequence, {out: (schedule, origin)}, seed)


def plan_cells(recording: Path, spec: Spec, patterns: tuple[str, ...], out: Path, format: Format = "asl") -> Plan:
    """A copy for each cell of a benchmark, in `out/CELL`.

    A cell that does not fit the recording is left out, unless it was asked for by its name.

    Raises:
        ConfigError: an unknown cell, one that was asked for and does not fit, none that fits, something else is
            where a cell should go, or `out` is in the recording.
        DataError: no recording.
    """
    check_apart(recording, out)
    sequence = _with_frames(recording)
    jobs: dict[Path, tuple[Schedule, Mapping[str, object]]] = {}
    left_out: list[str] = []
    for cell in spec.select(patterns):
        try:
            schedule = spec.schedule(cell, duration_s(sequence))
        except ConfigError as error:
            if cell in patterns:
                raise
            left_out.append(f"{cell} is left out: {error}")
            continue
        what = {"benchmark": spec.name, "cell": cell, "degrade": str(schedule), "seed": spec.seed}
        jobs[out / cell] = (schedule, {**_identity(sequence), **what})
    if not jobs:
        raise ConfigError(f"no cell fits: {'; '.join(left_out)}")
    done = tuple(folder for folder, (_, origin) in jobs.items() if _is_done(folder, origin, format))
    todo = {folder: job for folder, job in jobs.items() if folder not in done}
    for folder, (_, origin) in todo.items():
        check_request(folder, format, origin)
    return Plan(sequence, todo, spec.seed, tuple(left_out), done)


def carry_out(plan: Plan, format: Format = "asl", progress: Callable[[Path], Progress] | None = None) -> None:
    """Write what is planned; what is interrupted goes on when the same is planned again.

    Args:
        plan: from `plan_one` or `plan_cells`.
        format: EuRoC's layout, or a bag.
        progress: gives for each folder what is called with the number of images done and of all.
    """
    for folder, (schedule, origin) in plan.jobs.items():
        degraded = degrade_sequence(plan.sequence, schedule, plan.seed)
        report = progress(folder) if progress is not None else None
        write_recording(degraded, folder, format=format, origin=origin, progress=report)


def _is_done(folder: Path, origin: Mapping[str, object], format: Format) -> bool:
    """Whether a folder holds the recording of this origin, whole."""
    saved = folder / ORIGIN
    if not saved.is_file():
        return False
    try:
        return bool(json.loads(saved.read_text()) == json.loads(json.dumps({"format": format, **origin})))
    except ValueError:
        return False


def duration_s(sequence: Sequence) -> float:
    """Seconds from the first frame to the last."""
    return (sequence.frames[-1].t_ns - sequence.frames[0].t_ns) * 1e-9


def _with_frames(recording: Path) -> Sequence:
    sequence = open_sequence(recording)
    if not sequence.frames:
        raise ConfigError(f"{recording} has no frames to degrade")
    return sequence


def _identity(sequence: Sequence) -> dict[str, object]:
    return {"recording": sequence.name, "frames": len(sequence.frames), "first_ns": sequence.frames[0].t_ns}
