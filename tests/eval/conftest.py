"""What tests of studies share: somewhere to run them that needs no process of its own."""

import logging

import pytest
from distributed import LocalCluster


@pytest.fixture(scope="session")
def scheduler():
    """The address of a scheduler in this process, with one worker."""
    options = {"n_workers": 1, "threads_per_worker": 1, "processes": False, "dashboard_address": ":0"}
    with LocalCluster(**options, silence_logs=logging.ERROR) as cluster:
        yield cluster.scheduler_address
