"""All MAVLink microservices of the robot. A new one is a file in this folder and a line here."""

from __future__ import annotations

from typing import Final

from robotctl.mavlink.service import Microservice
from robotctl.mavlink.services.arming import Arming
from robotctl.mavlink.services.autopilot_version import AutopilotVersion
from robotctl.mavlink.services.battery import Battery
from robotctl.mavlink.services.can_forward import CanForward
from robotctl.mavlink.services.commands import Commands
from robotctl.mavlink.services.estimator import Estimator
from robotctl.mavlink.services.events import Events
from robotctl.mavlink.services.external_pose import ExternalPoses
from robotctl.mavlink.services.fences import Fences
from robotctl.mavlink.services.ftp import Ftp
from robotctl.mavlink.services.global_position import GlobalPosition
from robotctl.mavlink.services.ground_stations import GroundStations
from robotctl.mavlink.services.heartbeat import Heartbeat
from robotctl.mavlink.services.high_latency import HighLatency
from robotctl.mavlink.services.hud import Hud
from robotctl.mavlink.services.inertial import Inertial
from robotctl.mavlink.services.link_watch import LinkWatch
from robotctl.mavlink.services.log_download import LogDownload
from robotctl.mavlink.services.manual_control import ManualControls
from robotctl.mavlink.services.message_requests import MessageRequests
from robotctl.mavlink.services.missions import Missions
from robotctl.mavlink.services.mode_list import ModeList
from robotctl.mavlink.services.modes import Modes
from robotctl.mavlink.services.motor_controllers import MotorControllers
from robotctl.mavlink.services.navigation_output import NavigationOutput
from robotctl.mavlink.services.obstacles import Obstacles
from robotctl.mavlink.services.parameters import Parameters
from robotctl.mavlink.services.ping import Ping
from robotctl.mavlink.services.pose import Poses
from robotctl.mavlink.services.procedures import Procedures
from robotctl.mavlink.services.radio import Radios
from robotctl.mavlink.services.rally import RallyPoints
from robotctl.mavlink.services.reboot import Reboots
from robotctl.mavlink.services.refusals import Refusals
from robotctl.mavlink.services.reposition import Repositions
from robotctl.mavlink.services.reverse import Reverses
from robotctl.mavlink.services.setpoints import Setpoints
from robotctl.mavlink.services.signing_setup import SigningSetup
from robotctl.mavlink.services.sonars import Sonars
from robotctl.mavlink.services.status_text import StatusText
from robotctl.mavlink.services.streams import Streams
from robotctl.mavlink.services.system_status import SystemStatus
from robotctl.mavlink.services.system_time import SystemTime
from robotctl.mavlink.services.time_sync import TimeSync
from robotctl.mavlink.services.wheels import Wheels
from robotctl.mavlink.services.yaw_speed import YawSpeeds

SERVICES: Final[tuple[type[Microservice], ...]] = (
    # Who is there, and what they ask for.
    GroundStations,
    Commands,
    Arming,
    Modes,
    Setpoints,
    Repositions,
    YawSpeeds,
    Reboots,
    Procedures,
    Reverses,
    Refusals,
    ManualControls,
    ExternalPoses,
    TimeSync,
    Ping,
    SigningSetup,
    Radios,
    MessageRequests,
    # What the robot tells; streams start in this order.
    Heartbeat,
    AutopilotVersion,
    Poses,
    Wheels,
    Sonars,
    Inertial,
    Battery,
    SystemStatus,
    GlobalPosition,
    Hud,
    NavigationOutput,
    SystemTime,
    Estimator,
    Obstacles,
    ModeList,
    MotorControllers,
    HighLatency,
    Events,
    Missions,
    Fences,
    RallyPoints,
    Parameters,
    Ftp,
    LogDownload,
    CanForward,
    Streams,
    LinkWatch,
    StatusText,
)
"""In the order in which they are stepped."""
