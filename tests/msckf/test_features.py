"""The table of features against a plain dictionary that does the same, over random histories."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from msckf.features import FeatureTable
from navcore.frontend import Observations
from tests.msckf.scenes import ONE, STEREO


def seen(keys, cameras, uv):
    """Observations whose bearings can be told from the pixels."""
    uv = np.array(uv, dtype=float).reshape(-1, 2)
    bearings = np.column_stack([-uv, np.ones(len(uv))])
    return Observations(np.array(keys, dtype=np.int64), np.array(cameras, dtype=np.int64), uv, bearings)


class TableAgainstDictionary(RuleBasedStateMachine):
    """Clones are lists of {(key, camera): pixel}; `alive` is what the newest frame saw; both forget in the same way."""

    @initialize(cameras=st.integers(1, 3))
    def begin(self, cameras):
        self.cameras = cameras
        self.table = FeatureTable(cameras)
        self.clones = []
        self.keys = set()
        self.alive = set()
        self.clock = 0

    def spend(self, keys):
        for clone in self.clones:
            for key, camera in list(clone):
                if key in keys:
                    del clone[key, camera]

    def forget(self, keys):
        self.spend(keys)
        self.keys -= keys
        self.alive -= keys

    def mask(self, keys):
        return np.array([key in keys for key in self.table.keys.tolist()], dtype=bool)

    @rule(data=st.data())
    def add_clone(self, data):
        self.clock += 1
        one = st.tuples(st.integers(0, 9), st.integers(0, self.cameras - 1))
        views = data.draw(st.lists(one, unique=True, max_size=8))
        uv = {(key, camera): (10.0 * key + camera, float(self.clock)) for key, camera in views}
        self.table.add_clone(seen([v[0] for v in views], [v[1] for v in views], [uv[v] for v in views]))
        self.clones.append(uv)
        self.alive = {key for key, _ in views}
        self.keys |= self.alive

    @precondition(lambda self: self.clones)
    @rule(data=st.data())
    def drop_clone(self, data):
        k = data.draw(st.integers(0, len(self.clones) - 1))
        self.table.drop_clone(k)
        del self.clones[k]
        self.forget(self.keys - self.alive - {key for clone in self.clones for key, _ in clone})

    @precondition(lambda self: self.keys)
    @rule(data=st.data())
    def consume(self, data):
        spent = data.draw(st.sets(st.sampled_from(sorted(self.keys))))
        self.table.consume(self.mask(spent))
        self.spend(spent)
        self.forget(spent - self.alive)

    @precondition(lambda self: self.keys)
    @rule(data=st.data())
    def drop_rows(self, data):
        gone = data.draw(st.sets(st.sampled_from(sorted(self.keys))))
        self.table.drop_rows(self.mask(gone))
        self.forget(gone)

    @invariant()
    def agree(self):
        t, keys = self.table, sorted(self.keys)
        assert t.keys.tolist() == keys
        assert len(t) == len(keys)
        assert t.clones == len(self.clones)
        assert t.alive.tolist() == [key in self.alive for key in keys]
        assert t.uv.shape[:2] == t.seen.shape == (len(keys), len(self.clones) * self.cameras)
        assert t.views.tolist() == [sum(key == k for c in self.clones for k, _ in c) for key in keys]
        assert t.seen_from.tolist() == [[any(key == k for k, _ in clone) for clone in self.clones] for key in keys]
        for row, key in enumerate(keys):
            for k, clone in enumerate(self.clones):
                for camera in range(self.cameras):
                    pixel, column = clone.get((key, camera)), self.cameras * k + camera
                    assert t.seen[row, column] == (pixel is not None)
                    if pixel is not None:
                        assert tuple(t.uv[row, column]) == pixel
                        assert tuple(t.bearings[row, column]) == (-pixel[0], -pixel[1], 1.0)


TestTableAgainstDictionary = TableAgainstDictionary.TestCase


@given(order=st.permutations([3, 8, 1, 5]))
def test_the_order_in_which_features_come_does_not_matter(order):
    table = FeatureTable(1)
    table.add_clone(seen([5, 1], [0, 0], [[5.0, 0.0], [1.0, 0.0]]))
    table.add_clone(seen(order, [0] * 4, [[k, 1.0] for k in order]))
    assert table.keys.tolist() == [1, 3, 5, 8]
    assert table.uv[:, 1].tolist() == [[1.0, 1.0], [3.0, 1.0], [5.0, 1.0], [8.0, 1.0]]
    assert table.seen[:, 0].tolist() == [True, False, True, False]


def stereo():
    """Feature 1 seen by both cameras from three clones, 2 by the first camera only, 3 by the second from clone 2."""
    table = FeatureTable(2)
    for k in range(3):
        keys, cameras = [1, 1, 2], [0, 1, 0]
        if k == 2:
            keys, cameras = [*keys, 3], [*cameras, 1]
        table.add_clone(
            seen(keys, cameras, [[100.0 * c + 10.0 * k, key] for key, c in zip(keys, cameras, strict=True)])
        )
    return table


def test_views_of_a_table_stand_pose_by_pose_camera_by_camera():
    table = stereo()
    views = table.views_of(STEREO, np.array([True, False, True]), np.array([0, 2]))
    assert views.count == 2
    assert views.cameras.tolist() == [0, 1, 0, 1]
    assert views.poses.tolist() == [0, 0, 1, 1]
    assert views.seen.tolist() == [[True] * 4, [False, False, False, True]]
    assert views.uv[0, :, 0].tolist() == [0.0, 100.0, 20.0, 120.0]
    assert views.last.tolist() == [3, 3]
    everywhere = table.views_of(STEREO, np.array([True, True, True]))
    np.testing.assert_array_equal(everywhere.seen, table.seen)
    np.testing.assert_array_equal(everywhere.rays, table.bearings)


def test_flow_between_two_clones_is_within_one_camera():
    before, now = stereo().followed(0, 2)
    assert before.tolist() == [[0.0, 1.0], [100.0, 1.0], [0.0, 2.0]]
    assert now.tolist() == [[20.0, 1.0], [120.0, 1.0], [20.0, 2.0]]


@pytest.mark.parametrize("rig", [ONE, STEREO])
def test_bearings_are_those_of_the_intrinsics_in_use(rig):
    """The table's own were made by the calibration; pixels seen through another lens are other rays."""
    table, n = FeatureTable(len(rig)), len(rig)
    uv = 200.0 + 10.0 * np.arange(2.0 * n).reshape(-1, 2)
    bearings = np.stack([camera.unproject(x) for camera, x in zip(rig.cameras, uv, strict=True)])
    table.add_clone(Observations(np.full(n, 7), np.arange(n), uv, bearings))
    rows = np.array([True])
    np.testing.assert_array_equal(table.views_of(rig, rows).rays[0], bearings)
    other = rig.projects_otherwise(np.tile([5.0, 4.0, -3.0, 2.0, 0.01, 0.0, 0.0, 0.0], (n, 1)))
    expected = np.stack([camera.unproject(x) for camera, x in zip(other.cameras, uv, strict=True)])
    assert np.abs(expected - bearings).max() > 1e-3
    np.testing.assert_allclose(table.views_of(other, rows).rays[0], expected, atol=1e-14)
    elsewhere = replace(rig, poses=(rig.R_BC, rig.p_BC + 1.0))
    np.testing.assert_array_equal(table.views_of(elsewhere, rows).rays[0], bearings)
