"""What goes wrong with vision: when, how, how badly; for rendered and for real images."""

from sim.degrade.apply import degrade_sequence
from sim.degrade.schedule import Schedule
from sim.degrade.stream import restream

__all__ = ["Schedule", "degrade_sequence", "restream"]
