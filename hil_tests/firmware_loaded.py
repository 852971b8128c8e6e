"""Loads firmware_sim and its compiled kernels, for processes that are forked from this one."""

from firmware_sim.config.config import load_robot
from firmware_sim.faults import scenario  # noqa: F401
from firmware_sim.simulation import Simulation
from robotctl.config.robot_file import find_file

Simulation(load_robot(find_file("diff_drive")), find_file("empty_room", "worlds"), seed=1).warm()
