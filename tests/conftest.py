"""What all tests share: one BLAS thread, repeatable properties, and the recordings, if there are any."""

import os
from pathlib import Path

import pytest
from hypothesis import settings

for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):  # read when NumPy and SciPy are imported: not yet
    os.environ.setdefault(name, "1")

settings.register_profile("repeatable", derandomize=True, deadline=None, max_examples=50, database=None)
settings.load_profile("repeatable")


@pytest.fixture(scope="session")
def short_flight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a recording of three seconds with tracks, for commands that run an estimator on one."""
    from sim.output import write_recording  # NumPy must not be imported before the threads are set, above
    from sim.points import simulate_points

    folder = tmp_path_factory.mktemp("points") / "flight"
    write_recording(simulate_points("quadrotor", seconds=3.0), folder)
    return folder


@pytest.fixture(scope="session")
def vio_data() -> Path:
    """The folder of real recordings that the environment variable VIO_DATA names."""
    named = os.environ.get("VIO_DATA")
    if not named:
        pytest.skip("needs real recordings: VIO_DATA is not set")
    if not Path(named).is_dir():
        pytest.skip(f"needs real recordings: VIO_DATA={named} is no folder")
    return Path(named)
