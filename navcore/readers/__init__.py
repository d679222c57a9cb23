"""A path becomes a `Sequence`."""

from navcore.readers.layout import open_sequence

__all__ = ["open_sequence"]
