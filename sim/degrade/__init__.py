"""What goes wrong with vision: when, how, how badly; for rendered and for real images."""

from sim.degrade.apply import degrade_sequence
from sim.degrade.request import Request
from sim.degrade.schedule import Schedule
from sim.degrade.stream import restream

__all__ = ["Request", "Schedule", "degrade_sequence", "restream"]
