"""The commands of `python -m ipnet`, one a file: options as a dataclass, and `run`."""
