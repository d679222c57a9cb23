"""Recordings on disk."""

from sim.output.images import Progress
from sim.output.recording import FORMATS, Format, write_recording

__all__ = ["FORMATS", "Format", "Progress", "write_recording"]
