"""Requests of operators and ground stations: carried out, or refused with a reason."""

from __future__ import annotations

import math
from typing import TypeAlias

from robotctl.errors import MissionError
from robotctl.messages.mode import Mode
from robotctl.messages.requests import (
    AbortRequest,
    ExploreRequest,
    GoAheadRequest,
    HomeRequest,
    JumpRequest,
    ModeRequest,
    PlaceRequest,
    PositionRequest,
    Request,
    ReverseRequest,
    StickRequest,
    VelocityRequest,
    on_earth,
)
from robotctl.model.geometry.se2 import SE2
from robotctl.planning.behave.behaviours.goto import NO_PILOT
from robotctl.planning.behave.behaviours.goto_place import place_problems
from robotctl.planning.behave.behaviours.kind import NavigatedRobot
from robotctl.planning.behave.mission.mission_file import Mission
from robotctl.planning.behave.modes.auto import needs_pilot
from robotctl.planning.behave.modes.guided import TargetRequest
from robotctl.planning.behave.modes.modes import Modes
from robotctl.planning.navigation_step import LoadRequest
from robotctl.planning.supervision import DriveSupervision

_MissionRequest: TypeAlias = LoadRequest | GoAheadRequest | JumpRequest | AbortRequest


class Commander:
    """Takes requests one by one.

    Parameters
    ----------
    robot, modes
        The robot that drives, and its modes.
    supervision
        Knows which mode cannot be had now.

    Attributes
    ----------
    refused
        Why the last request was refused; empty: it was not.
    commands
        Number of requests to the mission that were carried out.
    home
        Goal of RTL; None: it was not moved since the start.
    """

    def __init__(self, robot: NavigatedRobot, modes: Modes, supervision: DriveSupervision) -> None:
        self._robot = robot
        self._modes = modes
        self._supervision = supervision
        self.refused = ""
        self.commands = 0
        self.home: SE2 | None = None

    def refusal(self, mode: Mode) -> str:
        """Return why a mode cannot be had, empty if it can."""
        return self._supervision.refusal(mode) or self._modes.refusal(mode)

    def take(self, request: Request | LoadRequest, now_ns: int, *, enabled: bool) -> None:
        """Take one request.

        Parameters
        ----------
        request
            The request. A velocity or sticks count in their own mode alone; a target counts only
            while `enabled`: arming must not set off to one that was sent long before.
        now_ns
            Time of this step [ns].
        enabled
            Whether the control core follows commands.
        """
        mode = self._modes.mode
        match request:
            case ModeRequest():
                self._change_mode(request, now_ns)
            case VelocityRequest():
                if mode is Mode.GUIDED:
                    self._modes.guided.take_velocity(request)
            case PositionRequest() | ExploreRequest() | PlaceRequest():
                if mode is Mode.GUIDED and enabled:
                    self._guide(request, now_ns)
            case StickRequest():
                if mode is Mode.MANUAL:
                    self._modes.manual.sticks = request
            case _:
                self._obey(request)

    def _change_mode(self, request: ModeRequest, now_ns: int) -> None:
        """Change the mode; not to one that drives and was asked for before a stop."""
        asked_ns = now_ns if request.stamp_ns is None else request.stamp_ns
        self.refused = self._supervision.outdated(request.mode, asked_ns) or self.refusal(
            request.mode
        )
        if not self.refused:
            self._modes.change(request.mode)

    def _guide(self, request: TargetRequest, now_ns: int) -> None:
        """Drive to a target in GUIDED, unless it is an unknown place."""
        if isinstance(request, PlaceRequest):
            self.refused = "; ".join(place_problems(request, self._robot.places))
            if self.refused:
                return
        self._modes.guided.take_target(request, now_ns)

    def _obey(self, request: ReverseRequest | HomeRequest | _MissionRequest) -> None:
        """Do what is asked, or note why it is refused."""
        try:
            match request:
                case ReverseRequest():
                    self._turn_round(request)
                case HomeRequest():
                    self._move_home(request)
                case _:
                    self._command_mission(request)
        except (MissionError, ValueError) as error:
            self.refused = str(error)
        else:
            self.refused = ""

    def _turn_round(self, request: ReverseRequest) -> None:
        """Drive to places in reverse from now on, or ahead again; `ValueError`: it cannot."""
        if request.reverse and self._modes.mode not in {Mode.AUTO, Mode.GUIDED}:
            raise ValueError("driving in reverse is for AUTO and GUIDED")
        if request.reverse and (why := self._robot.against_reverse):
            raise ValueError(f"driving in reverse: {why}")
        self._modes.use_reverse(reverse=request.reverse)

    def _move_home(self, to: HomeRequest) -> None:
        """Have RTL lead elsewhere; `ValueError`: it cannot now, or is no place."""
        if self._modes.mode is Mode.RTL:
            raise ValueError("home is not moved while the robot drives there")
        if not (on_earth(to.x_m, to.y_m) and math.isfinite(to.theta_rad)):
            raise ValueError(f"home: x {to.x_m:g}, y {to.y_m:g} is no place")
        self.begin_at(SE2(*to))

    def begin_at(self, home: SE2) -> None:
        """Have RTL lead to a pose in `world`; the way there is known from it on."""
        self._robot.crumbs.begin(home)
        self.home = home

    def _command_mission(self, request: _MissionRequest) -> None:
        """Do what is asked of the mission; `MissionError`, `ValueError`: it cannot be done."""
        auto, drives = self._modes.auto, self._modes.mode is Mode.AUTO
        if isinstance(request, LoadRequest):
            if drives and auto.is_under_way:
                raise MissionError("a mission is under way; pause or abort it first")
            self._require_pilot(request.mission)
            auto.load(request.mission)
        elif isinstance(request, GoAheadRequest) and not drives:
            raise MissionError("the mission is not under way")
        else:
            auto.command(request)
        if drives and isinstance(request, LoadRequest | AbortRequest):
            self._modes.change(Mode.HOLD)
        self.commands += 1

    def _require_pilot(self, mission: Mission | None) -> None:
        """Refuse a mission that only a pilot can drive if there is none (`MissionError`)."""
        if mission is not None and needs_pilot(mission) and self._robot.pilot is None:
            raise MissionError(f"{mission.name}: {NO_PILOT}")
