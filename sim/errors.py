"""What can go wrong in the simulator, as exceptions with one base."""


class SimError(Exception):
    """Base of every error that sim raises on purpose."""


class ConfigError(SimError, ValueError):
    """An option is unknown or out of range; the message says what came and what is allowed."""


class BusyError(ConfigError):
    """Another process is writing this very recording; the message says where."""


class RenderError(SimError, RuntimeError):
    """No image can be rendered here; the message says what is missing and how to get it."""
