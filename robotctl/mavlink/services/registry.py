"""All MAVLink microservices of the robot. A new one is a file in a folder and a line here."""

from __future__ import annotations

from typing import Final

from robotctl.mavlink.service import Microservice
from robotctl.mavlink.services.data.can_forward import CanForward
from robotctl.mavlink.services.data.ftp import Ftp
from robotctl.mavlink.services.data.log_download import LogDownload
from robotctl.mavlink.services.data.parameters import Parameters
from robotctl.mavlink.services.link.commands import Commands
from robotctl.mavlink.services.link.ground_stations import GroundStations
from robotctl.mavlink.services.link.link_watch import LinkWatch
from robotctl.mavlink.services.link.message_requests import MessageRequests
from robotctl.mavlink.services.link.ping import Ping
from robotctl.mavlink.services.link.radio import Radios
from robotctl.mavlink.services.link.signing_setup import SigningSetup
from robotctl.mavlink.services.link.streams import Streams
from robotctl.mavlink.services.link.time_sync import TimeSync
from robotctl.mavlink.services.plans.fences import Fences
from robotctl.mavlink.services.plans.missions import Missions
from robotctl.mavlink.services.plans.rally import RallyPoints
from robotctl.mavlink.services.telemetry.autopilot_version import AutopilotVersion
from robotctl.mavlink.services.telemetry.battery import Battery
from robotctl.mavlink.services.telemetry.estimator import Estimator
from robotctl.mavlink.services.telemetry.events import Events
from robotctl.mavlink.services.telemetry.global_position import GlobalPosition
from robotctl.mavlink.services.telemetry.heartbeat import Heartbeat
from robotctl.mavlink.services.telemetry.high_latency import HighLatency
from robotctl.mavlink.services.telemetry.hud import Hud
from robotctl.mavlink.services.telemetry.inertial import Inertial
from robotctl.mavlink.services.telemetry.motor_controllers import MotorControllers
from robotctl.mavlink.services.telemetry.navigation_output import NavigationOutput
from robotctl.mavlink.services.telemetry.obstacles import Obstacles
from robotctl.mavlink.services.telemetry.pose import Poses
from robotctl.mavlink.services.telemetry.sonars import Sonars
from robotctl.mavlink.services.telemetry.status_text import StatusText
from robotctl.mavlink.services.telemetry.step_times import StepTimes
from robotctl.mavlink.services.telemetry.system_status import SystemStatus
from robotctl.mavlink.services.telemetry.system_time import SystemTime
from robotctl.mavlink.services.telemetry.wheels import Wheels
from robotctl.mavlink.services.vehicle.arming import Arming
from robotctl.mavlink.services.vehicle.external_pose import ExternalPoses
from robotctl.mavlink.services.vehicle.home import Homes
from robotctl.mavlink.services.vehicle.manual_control import ManualControls
from robotctl.mavlink.services.vehicle.mode_list import ModeList
from robotctl.mavlink.services.vehicle.modes import Modes
from robotctl.mavlink.services.vehicle.procedures import Procedures
from robotctl.mavlink.services.vehicle.reboot import Reboots
from robotctl.mavlink.services.vehicle.reposition import Repositions
from robotctl.mavlink.services.vehicle.reverse import Reverses
from robotctl.mavlink.services.vehicle.setpoints import Setpoints
from robotctl.mavlink.services.vehicle.yaw_speed import YawSpeeds

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
    Homes,
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
    StepTimes,
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
"""All services, in the order in which they are stepped."""
