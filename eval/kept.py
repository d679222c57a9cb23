"""The files that priors name, kept in a study's folder: what is read is what was there when it was planned."""

import hashlib
import shutil
from pathlib import Path

from navcore.prior import split_prior


def kept(prior: str, workspace: Path) -> str:
    """The prior with its files in the study's folder, named by their content too; unchanged if it has none."""
    return ",".join(_part_kept(part, workspace) for part in split_prior(prior))


def _part_kept(part: str, workspace: Path) -> str:
    """The same of one source, whose argument may be a file, or the path of a folder of files."""
    name, _, argument = part.partition(":")
    given, mark, options = argument.partition("?")
    path = Path(given)
    if not (given and path.is_file()) and not ("/" in given and path.is_dir()):
        return part
    files = [path] if path.is_file() else sorted(p for p in path.iterdir() if p.is_file())
    digest = hashlib.sha256()
    for file in files:
        digest.update(file.name.encode() + b"\0" + file.read_bytes())
    copy = workspace / f"{path.stem}-{digest.hexdigest()[:8]}{path.suffix}"
    (workspace if path.is_file() else copy).mkdir(parents=True, exist_ok=True)
    for file in files:
        shutil.copyfile(file, copy if path.is_file() else copy / file.name)
    return f"{name}:{copy.name}{mark}{options}"
