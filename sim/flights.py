"""Motions kept on disk: physics runs once, noise and biases are drawn on it as often as one likes."""

import hashlib
import os
import zipfile
from collections.abc import Iterator
from dataclasses import fields
from importlib import metadata
from pathlib import Path

import numpy as np

import navcore
import sim
from navcore.errors import DataError
from sim.errors import ConfigError
from sim.motion import Motion
from sim.platforms import simulate_motion

CODE = {
    sim: ("platforms", "motion.py", "streams.py", "errors.py"),
    navcore: ("so3.py", "arrays.py", "imu.py", "trajectory.py", "errors.py"),
}
"""What decides how a platform moves: files and folders by package. Where one of them changes, flights are new."""
_DISTRIBUTIONS = ("mujoco", "numpy", "scipy")


def flight(
    platform: str = "quadrotor",
    seconds: float = 60.0,
    seed: int = 1,
    moving_start: bool = False,
    difficulty: str = "medium",
    folder: Path | None = None,
) -> Motion:
    """The motion that `simulate_motion` makes, to the last bit, from `folder` if it is kept there.

    A minute takes 10 MB. A file is written whole or not at all, so processes may share a folder; one that
    cannot be read is made anew.

    Args:
        platform, seconds, seed, moving_start, difficulty: as for `simulate_motion`.
        folder: where motions are kept; made if it is not there. None keeps nothing.

    Raises:
        ConfigError: as `simulate_motion` does, or the folder cannot be written to.
    """
    if folder is None:
        return simulate_motion(platform, seconds, seed, moving_start, difficulty)
    wanted = repr((platform, float(seconds), seed, moving_start, difficulty))
    name = hashlib.sha256((wanted + code_digest()).encode()).hexdigest()[:16]
    path = folder / f"{platform}-{difficulty}-seed{seed}-{name}.npz"
    motion = _load(path)
    if motion is None:
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise ConfigError(f"{folder} cannot be a folder for flights: {error.strerror}") from error
        motion = simulate_motion(platform, seconds, seed, moving_start, difficulty)
        _save(path, motion)
    return motion


def code_digest() -> str:
    """A hash of all that decides how a platform moves, the versions of what it is computed with included."""
    digest = hashlib.sha256()
    for path in code_files():
        digest.update(path.name.encode() + path.read_bytes())
    digest.update(repr([(name, metadata.version(name)) for name in _DISTRIBUTIONS]).encode())
    return digest.hexdigest()


def code_files() -> Iterator[Path]:
    """The files that `code_digest` reads, in a fixed order."""
    for package, parts in CODE.items():
        for part in parts:
            place = Path(package.__path__[0]) / part
            inside = sorted(p for p in place.rglob("*") if p.suffix in (".py", ".xml")) if place.is_dir() else [place]
            yield from inside


def _load(path: Path) -> Motion | None:
    """The motion in a file; None if it is not there, or spoiled."""
    try:
        with np.load(path) as arrays:
            values = {field.name: arrays[field.name] for field in fields(Motion)}
        return Motion(**{name: value if value.ndim else value.item() for name, value in values.items()})
    except (OSError, EOFError, KeyError, ValueError, zipfile.BadZipFile, ConfigError, DataError):
        return None


def _save(path: Path, motion: Motion) -> None:
    partial = path.with_name(f"{path.name}.{os.getpid()}.partial")
    try:
        with partial.open("wb") as file:
            np.savez(file, **{field.name: getattr(motion, field.name) for field in fields(Motion)})
        partial.replace(path)
    except OSError as error:
        partial.unlink(missing_ok=True)
        raise ConfigError(f"{path} cannot be written: {error.strerror}") from error
