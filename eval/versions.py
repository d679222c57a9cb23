"""What results depend on apart from their config: interpreter, libraries, code, and the weights of priors."""

import hashlib
from collections.abc import Collection
from collections.abc import Sequence as ListLike
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path
from platform import python_version

from navcore.errors import ConfigError
from navcore.prior import prior_entry

_DISTRIBUTIONS = ("msckf-ipnet", "numpy", "scipy", "opencv-python-headless", "mujoco", "onnxruntime", "gtsam")
_SCORING = (
    "alignment.py",
    "metrics.py",
    "consistency.py",
    "records.py",
    "flights.py",
    "sources.py",
    "statements.py",
    "work.py",
)
"""The files of this package that decide what a result says; the others only show it."""
_PRIOR, _ESTIMATOR = "prior ", "estimator "  # begin the names of versions that only their own cells depend on
_BEGINS_WITH = "msckf"  # the estimator whose start others use
_CODE = (".py", ".xml")
_WEIGHTS = (".json", ".yaml", ".npz", ".onnx", ".safetensors")


def versions(estimators: tuple[str, ...] = ("msckf",), priors: tuple[str, ...] = ()) -> dict[str, str]:
    """What results depend on apart from their config: interpreter, libraries, the code of this project, and of
    priors of other packages the code and the weights.

    Args:
        estimators: as in `Cell.estimator`; the package of each one counts.
        priors: as in `Cell.priors`.
    """
    found = {name: _version(name) for name in _DISTRIBUTIONS}
    scoring = [Path(__file__).with_name(name) for name in _SCORING]
    run = {_ESTIMATOR + name: code_digest({_package(name), _BEGINS_WITH}) for name in estimators}
    told = {_PRIOR + name: version for name in priors if (version := _prior_version(name))}
    return {"python": python_version(), **found, "code": code_digest(("navcore", "sim"), scoring), **run, **told}


def of_cell(versions: dict[str, str], estimator: str, priors: ListLike[str]) -> dict[str, str]:
    """Those versions that a result of this estimator with these priors depends on."""
    own = {_ESTIMATOR + estimator, *(_PRIOR + name for name in priors)}
    return {n: version for n, version in versions.items() if not n.startswith((_PRIOR, _ESTIMATOR)) or n in own}


def code_digest(packages: Collection[str], files: ListLike[Path] = ()) -> str:
    """A hash of all sources of some packages and of further files: changed code gives other results."""
    digest = hashlib.sha256()
    for package in sorted(packages):
        for file in sorted(_files(package, _CODE)):
            digest.update(file.read_bytes())
    for file in files:
        digest.update(file.read_bytes())
    return digest.hexdigest()[:12]


def _version(distribution: str) -> str:
    try:
        return metadata.version(distribution)
    except metadata.PackageNotFoundError:
        return "not installed"


def _package(estimator: str) -> str:
    """The top-level package behind an estimator's name."""
    if ":" in estimator:
        return estimator.split(":")[0].split(".")[0]
    for entry in metadata.entry_points(group="navcore.odometry", name=estimator):
        return entry.module.split(".")[0]
    return estimator


def _prior_version(name: str) -> str:
    """Of the distribution that a prior comes with, and a hash of its package, weights included; empty for
    `navcore`'s own, whose code counts for every cell."""
    try:
        entry = prior_entry(name)
    except ConfigError:
        return "unknown"
    package = entry.module.split(".")[0]
    if package == "navcore":
        return ""
    digest = hashlib.sha256()
    for file in sorted(_files(package, _CODE + _WEIGHTS)):
        digest.update(file.name.encode() + b"\0" + file.read_bytes())
    distribution = f"{entry.dist.name} {entry.dist.version} " if entry.dist is not None else ""
    return distribution + digest.hexdigest()[:12]


def _files(package: str, suffixes: tuple[str, ...]) -> set[Path]:
    """All files of a package with one of these suffixes; of a module without a folder, itself."""
    spec = find_spec(package)
    if spec is None:
        return set()
    folders = {Path(place).resolve() for place in spec.submodule_search_locations or []}
    if not folders:
        return {Path(spec.origin)} if spec.origin is not None else set()
    return {f for folder in folders for f in folder.rglob("*") if f.suffix in suffixes}
