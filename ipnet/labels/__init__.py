"""Labels: the one bias of a recording under which its preintegrated IMU meets the truth."""

from ipnet.labels.files import read_rows, row, write_rows
from ipnet.labels.filter_run import GoodPath, good_path
from ipnet.labels.label import LabelConfig, Measured, SolvedLabel, label

__all__ = [
    "GoodPath",
    "LabelConfig",
    "Measured",
    "SolvedLabel",
    "good_path",
    "label",
    "read_rows",
    "row",
    "write_rows",
]
