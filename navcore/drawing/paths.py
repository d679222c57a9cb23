"""Names of what is drawn, and of the time it is drawn at."""

TIMELINE = "time"
"""Seconds from the first frame, in IMU time."""

WORLD = "world"
PATH, TRUTH, SPREAD, BODY = (f"{WORLD}/{name}" for name in ("path", "truth", "spread", "body"))
HEALTH, REASONS, FEATURES = "health", "reasons", "features"
AXES = ("x", "y", "z")
BIASES = {"b_g": "gyroscope bias [rad/s]", "b_a": "accelerometer bias [m/s²]"}


def camera(index: int) -> str:
    """A camera of the rig."""
    return f"{BODY}/cam{index}"


def bias(name: str, axis: str) -> str:
    """One axis of `b_g` or `b_a`."""
    return f"biases/{name}/{axis}"
