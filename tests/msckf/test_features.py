"""The table of features against a plain dictionary that does the same, over random histories."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from msckf.features import FeatureTable


def add(table, keys, cameras, uv):
    """A column whose bearings can be told from the pixels."""
    uv = np.array(uv, dtype=float).reshape(-1, 2)
    bearings = np.column_stack([-uv, np.ones(len(uv))])
    table.add_column(np.array(keys, dtype=np.int64), np.array(cameras, dtype=np.int64), uv, bearings)


class TableAgainstDictionary(RuleBasedStateMachine):
    """Columns are lists of {key: pixel}; `alive` is the newest frame's keys; both forget in the same way."""

    def __init__(self):
        super().__init__()
        self.table = FeatureTable()
        self.columns = []
        self.keys = {}
        self.alive = set()
        self.clock = 0

    def arrays(self):
        return np.array([self.columns_of(key) for key in sorted(self.keys)])

    def columns_of(self, key):
        return [column.get(key) for column in self.columns]

    def forget(self, keys):
        for key in keys:
            del self.keys[key]
            for column in self.columns:
                column.pop(key, None)

    @rule(seen=st.lists(st.integers(0, 12), unique=True, max_size=8))
    def add_column(self, seen):
        self.clock += 1
        uv = {key: (float(key), float(self.clock)) for key in seen}
        add(self.table, seen, [key % 2 for key in seen], [uv[key] for key in seen])
        self.columns.append(uv)
        self.keys |= {key: key % 2 for key in seen}
        self.alive = set(seen)

    @precondition(lambda self: self.columns)
    @rule(data=st.data())
    def drop_column(self, data):
        k = data.draw(st.integers(0, len(self.columns) - 1))
        self.table.drop_column(k)
        del self.columns[k]
        self.forget([key for key in self.keys if key not in self.alive and not any(key in c for c in self.columns)])

    @precondition(lambda self: self.keys)
    @rule(data=st.data())
    def consume(self, data):
        spent = data.draw(st.sets(st.sampled_from(sorted(self.keys))))
        self.table.consume(np.array([key in spent for key in self.table.keys.tolist()]))
        for column in self.columns:
            for key in spent:
                column.pop(key, None)
        self.forget(spent - self.alive)

    @precondition(lambda self: self.keys)
    @rule(data=st.data())
    def drop_rows(self, data):
        gone = data.draw(st.sets(st.sampled_from(sorted(self.keys))))
        self.table.drop_rows(np.array([key in gone for key in self.table.keys.tolist()]))
        self.forget(gone)
        self.alive -= gone

    @rule()
    def mark_lost(self):
        self.table.mark_lost()
        self.alive = set()

    @rule()
    def clear(self):
        self.table.clear()
        self.columns, self.keys, self.alive = [], {}, set()

    @invariant()
    def agree(self):
        t = self.table
        assert t.keys.tolist() == sorted(self.keys)
        assert t.cameras.tolist() == [self.keys[key] for key in sorted(self.keys)]
        assert t.alive.tolist() == [key in self.alive for key in sorted(self.keys)]
        assert t.uv.shape[:2] == t.seen.shape == (len(self.keys), len(self.columns))
        assert t.views.tolist() == [sum(key in c for c in self.columns) for key in sorted(self.keys)]
        for row, key in enumerate(sorted(self.keys)):
            for k, pixel in enumerate(self.columns_of(key)):
                assert t.seen[row, k] == (pixel is not None)
                if pixel is not None:
                    assert tuple(t.uv[row, k]) == pixel
                    assert tuple(t.bearings[row, k]) == (-pixel[0], -pixel[1], 1.0)


TestTableAgainstDictionary = TableAgainstDictionary.TestCase


@given(order=st.permutations([3, 8, 1, 5]))
def test_the_order_in_which_features_come_does_not_matter(order):
    table = FeatureTable()
    add(table, [5, 1], [0, 0], [[5.0, 0.0], [1.0, 0.0]])
    add(table, order, [0] * 4, [[k, 1.0] for k in order])
    assert table.keys.tolist() == [1, 3, 5, 8]
    assert table.uv[:, 1].tolist() == [[1.0, 1.0], [3.0, 1.0], [5.0, 1.0], [8.0, 1.0]]
    assert table.seen[:, 0].tolist() == [True, False, True, False]
