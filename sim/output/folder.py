"""The folder of a recording: there whole, or not at all; what is interrupted goes on where it stopped."""

import fcntl
import hashlib
import json
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from importlib.metadata import version
from pathlib import Path

import navcore
from sim.errors import BusyError, ConfigError

MANIFEST = "manifest.json"
ORIGIN = "origin.json"
_LOCK = "lock"
_LIBRARIES = ("numpy", "scipy", "opencv-python-headless", "mujoco")
_SOURCES = (".py", ".xml", ".yaml")

Origin = Mapping[str, object]
"""What a recording is made from, as JSON can hold it: all that its bytes depend on but the code."""


def check_new(out: Path, origin: Origin | None) -> None:
    """Raise unless a recording of this origin can be written to `out`.

    Raises:
        ConfigError: `out` is not empty, or an interrupted recording of another origin is beside it.
    """
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise ConfigError(f"{out} is there already; expected a new or empty folder")
    manifest = _partial(out) / MANIFEST
    if manifest.is_file() and (origin is None or manifest.read_text() != _manifest(origin)):
        raise ConfigError(
            f"{_partial(out)} is an interrupted recording of another origin or by other code; delete it, choose"
            f" another folder, or let it go on as it began ({_difference(manifest.read_text(), origin)})"
        )


@contextmanager
def new_folder(out: Path, origin: Origin | None) -> Iterator[Path]:
    """A folder to write into, beside `out`; it becomes `out` if all goes well and vanishes on an error.

    If it is interrupted (Ctrl-C, or the process is killed) it stays, and what is in it is there again when the
    same origin comes next; without an origin it vanishes.

    Raises:
        BusyError: another process is writing it.
        ConfigError: as `check_new` does, or the folder cannot be made.
    """
    check_new(out, origin)
    partial = _partial(out)
    try:
        partial.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(f"{out} cannot be made: {error.strerror}") from error
    with _alone(partial):
        _begin(partial, origin)
        try:
            yield partial
        except BaseException as error:
            if origin is None or isinstance(error, Exception):
                shutil.rmtree(partial, ignore_errors=True)
            raise
        if out.exists():
            out.rmdir()
        partial.rename(out)
        for name in (MANIFEST, _LOCK):
            (out / name).unlink(missing_ok=True)


@contextmanager
def _alone(partial: Path) -> Iterator[None]:
    """Hold a folder against other processes; when one dies, however it dies, the system lets go of it."""
    with (partial / _LOCK).open("w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise BusyError(f"{partial} is being written by another process") from error
        yield


def _begin(partial: Path, origin: Origin | None) -> None:
    """Keep what can go on, throw away what cannot."""
    if not (partial / MANIFEST).is_file():
        for path in partial.iterdir():
            if path.is_dir():
                shutil.rmtree(path)
            elif path.name != _LOCK:
                path.unlink()
    if origin is not None:
        write_whole(partial / ORIGIN, _json(origin).encode())
        write_whole(partial / MANIFEST, _manifest(origin).encode())


def write_whole(path: Path, data: bytes) -> None:
    """A file that is there with all its bytes or not at all."""
    partial = path.with_name(path.name + ".partial")
    partial.write_bytes(data)
    partial.replace(path)


def copy_whole(source: Path, path: Path) -> None:
    """The same with the bytes of another file."""
    partial = path.with_name(path.name + ".partial")
    shutil.copyfile(source, partial)
    partial.replace(path)


def require_space(out: Path, needed: int) -> None:
    """Raise unless `needed` bytes are free where `out` will be.

    Raises:
        ConfigError: they are not; the message has both numbers.
    """
    place = next(x for x in out.resolve().parents if x.exists())
    free = shutil.disk_usage(place).free
    if needed > free:
        raise ConfigError(f"{out} may take {needed / 1e9:.3f} GB, and {free / 1e9:.3f} GB are free in {place}")


def _partial(out: Path) -> Path:
    place = out.resolve()
    return place.with_name(place.name + ".partial")


def _json(content: object) -> str:
    return json.dumps(content, indent=1, sort_keys=True) + "\n"


def _manifest(origin: Origin) -> str:
    return _json({"origin": dict(origin), "code": _code(), "libraries": {x: version(x) for x in _LIBRARIES}})


@cache
def _code() -> str:
    """A digest of everything that makes the bytes of a recording."""
    digest = hashlib.sha256()
    assert navcore.__file__ is not None
    for package in (Path(navcore.__file__).parent, Path(__file__).parents[1]):
        for path in sorted(x for x in package.rglob("*") if x.suffix in _SOURCES):
            digest.update(str(path.relative_to(package)).encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


def _difference(began: str, origin: Origin | None) -> str:
    """What an interrupted recording was made from, where it is something else."""
    try:
        before = json.loads(began)
        now = json.loads(_manifest(origin or {}))
        changed = {k: v for k, v in before["origin"].items() if now["origin"].get(k) != v}
        return f"it began with {json.dumps(changed)}" if changed else "by other code or libraries"
    except (ValueError, KeyError, TypeError, AttributeError):
        return "its manifest cannot be read"
