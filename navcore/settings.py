"""Settings in nested dataclasses, replaced by dotted name."""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from typing import Any, TypeVar

from navcore.errors import ConfigError

Config = TypeVar("Config")


def with_overrides(config: Config, overrides: Mapping[str, Any]) -> Config:
    """A copy with settings replaced by dotted name, as `{"vision.fej": False}`.

    Raises:
        ConfigError: a name is unknown, and the message lists the known ones; or a value is of another type.
    """
    changed: Any = config
    for name, value in overrides.items():
        changed = _replaced(changed, name, name.split("."), value)
    copy: Config = changed
    return copy


def _replaced(config: Any, whole: str, path: list[str], value: Any) -> Any:
    known = [f.name for f in fields(config)]
    if path[0] not in known:
        raise ConfigError(f"config key {whole!r} is unknown: {path[0]!r} is none of {', '.join(known)}")
    old = getattr(config, path[0])
    if len(path) > 1:
        if not is_dataclass(old):
            raise ConfigError(f"config key {whole!r} is unknown: {path[0]!r} has no parts")
        return replace(config, **{path[0]: _replaced(old, whole, path[1:], value)})
    if is_dataclass(old) or (type(value) is not type(old) and not (isinstance(old, float) and isinstance(value, int))):
        raise ConfigError(f"config key {whole!r} takes {type(old).__name__}, got {value!r}")
    return replace(config, **{path[0]: value})
