"""What can go wrong in the shared language, as exceptions with one base."""


class NavcoreError(Exception):
    """Base of every error that navcore raises on purpose."""


class DataError(NavcoreError, ValueError):
    """A file, sample or frame is not what it should be; the message names it and says what was expected."""


class ConfigError(NavcoreError, ValueError):
    """An option or a specification is unknown or out of range; the message lists what is allowed."""


class InputError(NavcoreError, ValueError):
    """A sample or a frame cannot follow what came before; the message names its time."""
