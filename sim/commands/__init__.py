"""The commands of `python -m sim`, one a file: options as a dataclass, and `run`."""
