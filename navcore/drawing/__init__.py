"""A run as Rerun shows it: needs rerun-sdk, and is imported by those who draw."""

from navcore.drawing.canvas import Canvas
from navcore.drawing.drawn import Drawn
from navcore.drawing.stream import open_stream

__all__ = ["Canvas", "Drawn", "open_stream"]
