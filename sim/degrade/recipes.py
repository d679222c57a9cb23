"""The numbers behind all kinds and severities in one place, and their fingerprint: a benchmark is frozen with them."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, is_dataclass

from sim.camera.exposure import EXPOSURE_S
from sim.degrade.codec import JPEG_QUALITY
from sim.degrade.dirt import LENS_DIRT
from sim.degrade.exposure import AUTO_EXPOSURE, LOW_LIGHT, OVEREXPOSURE
from sim.degrade.fog import FOG
from sim.degrade.lamps import LIGHT_SWITCH
from sim.degrade.movers import MOVING_OBJECTS
from sim.degrade.stream import FRAME_DROPS, LOW_RATE, TIME_JITTER_S, TIME_OFFSET_S
from sim.degrade.texture import TEXTURE_LOSS

RECIPES: Mapping[str, Sequence[object]] = {
    "motion_blur": EXPOSURE_S[1:],
    "texture_loss": TEXTURE_LOSS,
    "light_switch": LIGHT_SWITCH,
    "moving_objects": MOVING_OBJECTS,
    "fog": FOG,
    "lens_dirt": LENS_DIRT,
    "low_light": LOW_LIGHT,
    "overexposure": OVEREXPOSURE,
    "auto_exposure": AUTO_EXPOSURE,
    "jpeg": JPEG_QUALITY,
    "frame_drops": FRAME_DROPS,
    "low_rate": LOW_RATE,
    "time_jitter": TIME_JITTER_S,
    "time_offset": TIME_OFFSET_S,
}
"""By kind that can be done to any recording, then by severity from 1."""


def fingerprint() -> str:
    """A hash that changes with any of the numbers."""
    plain = {kind: [_plain(recipe) for recipe in recipes] for kind, recipes in RECIPES.items()}
    return hashlib.sha256(json.dumps(plain, sort_keys=True).encode()).hexdigest()[:16]


def _plain(recipe: object) -> object:
    return asdict(recipe) if is_dataclass(recipe) and not isinstance(recipe, type) else recipe
