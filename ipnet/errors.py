"""What can go wrong in bias inference, as exceptions with one base."""


class IpnetError(Exception):
    """Base of every error that ipnet raises on purpose."""


class ConfigError(IpnetError, ValueError):
    """An option or a name is unknown or out of range; the message lists what is allowed."""


class LabelError(IpnetError, ValueError):
    """A recording or a file of labels lacks what a label needs; the message names it and says what."""
