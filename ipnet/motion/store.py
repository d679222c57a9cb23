"""Motion models in files, with what is wrong with their statements and what they were learned from."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ipnet.calibration import ErrorModel
from ipnet.directions import for_both
from ipnet.errors import ConfigError
from ipnet.files import write_text
from ipnet.motion.model import MotionModel
from navcore.arrays import Floats, frozen
from navcore.imu import ImuNoise

FOLDER = Path(__file__).parent / "models"


@dataclass(frozen=True)
class MotionCard:
    """A motion model and what is known of it.

    Attributes:
        model: how the platform moves.
        noise: of the IMUs it was learned with, for live use without a calibration.
        R_FB: (3, 3) from B to the axes of `errors`: along the usual specific force, and across it.
        errors: what is wrong with its statements, found on recordings that the model had not seen.
        training: names of the recordings learned from.
        validation: names of those by which `errors` was found; where they are also in `training`, each was left out
            of a model of its own.
        made: how.
    """

    model: MotionModel
    noise: ImuNoise
    R_FB: Floats
    errors: ErrorModel
    training: tuple[str, ...]
    validation: tuple[str, ...]
    made: dict[str, Any]

    def __post_init__(self) -> None:
        object.__setattr__(self, "R_FB", frozen("R_FB", self.R_FB, np.float64, (3, 3)))
        known = (self.R_FB, *vars(self.errors).values(), *vars(self.noise).values())
        if not all(np.isfinite(values).all() for values in known):
            raise ConfigError("axes, errors or noise of a motion model are not finite")

    @property
    def R6(self) -> Floats:
        """(6, 6) for both sensors."""
        return for_both(self.R_FB)

    def write(self, path: Path) -> None:
        """Write it as JSON."""
        content = {
            "model": {k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in vars(self.model).items()},
            "noise": vars(self.noise),
            "R_FB": self.R_FB.tolist(),
            "errors": self.errors.as_dict(),
            "training": self.training,
            "validation": self.validation,
            "made": self.made,
        }
        write_text(path, json.dumps(content, indent=1) + "\n")

    @staticmethod
    def read(path: Path) -> "MotionCard":
        """From a file that `write` made.

        Raises:
            ConfigError: it is not such a file.
        """
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
            return MotionCard(
                MotionModel(**content["model"]),
                ImuNoise(**content["noise"]),
                content["R_FB"],
                ErrorModel.from_dict(content["errors"]),
                tuple(content["training"]),
                tuple(content["validation"]),
                content["made"],
            )
        except (ValueError, TypeError, KeyError) as error:
            raise ConfigError(f"{path}: not a motion model as `python -m ipnet learn` writes it: {error!r}") from error


def find(name: str) -> Path:
    """The file of a shipped model, or the one at that path.

    Raises:
        ConfigError: there is none; the message lists the names.
    """
    shipped = FOLDER / f"{name}.json"
    if name and shipped.is_file() and "/" not in name:
        return shipped
    if name and Path(name).is_file():
        return Path(name)
    names = ", ".join(sorted(p.stem for p in FOLDER.glob("*.json")))
    raise ConfigError(f"motion model {name!r} is unknown; known are {names}, and files that `learn` wrote")
