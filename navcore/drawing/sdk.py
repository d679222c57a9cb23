"""The Rerun SDK, or a word on how to get it."""

from navcore.errors import ConfigError

try:
    import rerun as rr
    import rerun.blueprint as rrb
except ImportError as error:
    raise ConfigError("drawing needs rerun-sdk: pip install 'msckf-ipnet[viz]'") from error

__all__ = ["rr", "rrb"]
