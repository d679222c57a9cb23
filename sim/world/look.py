"""How surfaces look: the style of their texture."""

from dataclasses import dataclass
from typing import Literal

Pattern = Literal["leaves", "windows", "sky"]
"""Shapes thrown over each other; the same with rows of windows on upright surfaces; soft clouds."""


@dataclass(frozen=True)
class Look:
    """The style of a texture. Shades are albedo in 1/255.

    Attributes:
        ground: range of the shade under the shapes.
        contrast: typical difference of a shape from the ground; a few differ by much more.
        leaves_per_m2: shapes on a surface that is looked at from near.
        largest_m: size of the largest ones.
        grain: relative, sd of the finest detail.
        pattern: what is drawn.
    """

    ground: tuple[float, float] = (80.0, 150.0)
    contrast: float = 18.0
    leaves_per_m2: float = 90.0
    largest_m: float = 1.2
    grain: float = 0.05
    pattern: Pattern = "leaves"

    @property
    def shines(self) -> bool:
        """Whether it gives its own light, and is no surface on which features can be placed."""
        return self.pattern == "sky"


PAINTED = Look()
"""Walls and things with much on them."""
CONCRETE = Look(ground=(75.0, 115.0), contrast=14.0)
MACHINE = Look(ground=(45.0, 170.0), contrast=22.0, largest_m=0.8)
PLAIN = Look(ground=(135.0, 165.0), contrast=6.0, leaves_per_m2=5.0, largest_m=0.5, grain=0.015)
"""A painted wall with a few marks."""
LINOLEUM = Look(ground=(90.0, 120.0), contrast=6.0, leaves_per_m2=12.0, largest_m=0.3, grain=0.03)
WOOD = Look(ground=(60.0, 100.0), contrast=6.0, leaves_per_m2=10.0, largest_m=0.3, grain=0.03)
NOTICE = Look(ground=(120.0, 190.0), contrast=30.0, leaves_per_m2=150.0, largest_m=0.3)
SOIL = Look(ground=(70.0, 100.0), contrast=16.0, leaves_per_m2=110.0, largest_m=0.9, grain=0.08)
FRONT = Look(ground=(95.0, 165.0), contrast=12.0, largest_m=0.6, pattern="windows")
"""A house front."""
BOARDS = Look(ground=(60.0, 130.0), contrast=20.0, largest_m=0.5)
FOLIAGE = Look(ground=(40.0, 70.0), contrast=24.0, leaves_per_m2=200.0, largest_m=0.4, grain=0.1)
SKY = Look(ground=(190.0, 205.0), contrast=16.0, grain=0.0, pattern="sky")
