"""Labels: the one bias of a recording under which its preintegrated IMU meets the truth."""

from ipnet.labels.files import write_labels
from ipnet.labels.label import LabelConfig, label

__all__ = ["LabelConfig", "label", "write_labels"]
