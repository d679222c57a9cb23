"""Small helpers on arrays."""

import numpy as np
import pytest

from navcore.arrays import among


@pytest.mark.parametrize(
    ("keys", "others", "expected"),
    [
        ([3, 1, 9, 3], [9, 3], [True, False, True, True]),
        ([0, 10], [5], [False, False]),
        ([1, 2], [], [False, False]),
        ([], [1, 2], []),
    ],
    ids=["any order", "beyond both ends", "among none", "none"],
)
def test_among(keys, others, expected):
    found = among(np.array(keys, dtype=np.int64), np.array(others, dtype=np.int64))
    assert found.dtype == bool
    assert found.tolist() == expected
