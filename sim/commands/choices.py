"""Names that options may have, from the registries; `--help` lists them."""

from typing import TYPE_CHECKING

from tyro.extras import literal_type_from_choices

from sim.imu import GRADES
from sim.platforms import DIFFICULTIES, PLATFORMS
from sim.world import SCENES

if TYPE_CHECKING:
    PlatformName = str
    SceneName = str
    DifficultyName = str
    GradeName = str
else:
    PlatformName = literal_type_from_choices(PLATFORMS)
    SceneName = literal_type_from_choices(SCENES)
    DifficultyName = literal_type_from_choices(DIFFICULTIES)
    GradeName = literal_type_from_choices([*GRADES, *(f"{name}-uncalibrated" for name in GRADES)])
