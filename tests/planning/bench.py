"""Missions, modes and obstacles for robots in the simulated flat."""

from robotctl.messages.mode import Mode
from robotctl.messages.requests import (
    ModeRequest,
)
from robotctl.planning.behave.behaviours.follow_path import DriveItem
from robotctl.planning.behave.mission.mission_file import Mission, StartPose

LATER = 10**15
AUTO = ModeRequest(Mode.AUTO)
RTL = ModeRequest(Mode.RTL)
HOLD = ModeRequest(Mode.HOLD)
GUIDED = ModeRequest(Mode.GUIDED)
MANUAL = ModeRequest(Mode.MANUAL)


def mission(*items, x=1.0, y=1.0):
    return Mission("test", StartPose(x, y), items)


def ahead(x, speed=0.4):
    return DriveItem("drive", ((1.0, 1.0), (x, 1.0)), speed_m_s=speed, name="ahead")
