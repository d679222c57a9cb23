"""What can go wrong in the filter, as exceptions with one base."""


class MsckfError(Exception):
    """Base of every error that the filter raises on purpose."""


class InputError(MsckfError, ValueError):
    """A sample or a frame cannot follow what came before; the message names its time."""
