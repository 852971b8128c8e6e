"""The navigator between messages: control state and requests in, velocity and own state out."""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterable, Sequence
from typing import Final, NamedTuple, TypeAlias

import msgspec

from robotctl.core.fence_keeper import FenceKeeper
from robotctl.core.navigation_requests import too_late, translated
from robotctl.core.plan_view import PlanViews
from robotctl.core.sightings import Sightings
from robotctl.core.station_watch import StationWatch
from robotctl.core.told_views import Told, ToldViews
from robotctl.errors import ConfigError, MissionError
from robotctl.estimation.ranging.own_body import without_body
from robotctl.messages.control import (
    ControlState,
    ExternalPose,
    GroundStationPresence,
    NavigationRequest,
    NavigationState,
    VelocityCommand,
)
from robotctl.messages.estimation import (
    CameraView,
    LidarScan,
    LocalisationState,
    PlanView,
    SensorMessage,
)
from robotctl.messages.fence import EnableFence, SetFence, SetRally
from robotctl.messages.mission import LoadMission
from robotctl.messages.plans import BoundsView, DrawnZone, KnownPlace, MissionView, SetZones
from robotctl.messages.tuning import Tuning
from robotctl.messages.world_pose import WorldPose
from robotctl.model.geometry.se2 import SE2
from robotctl.model.geometry.twist import Twist
from robotctl.planning.behave.mission.mission_file import Mission, parse_mission
from robotctl.planning.config import NavigationConfig
from robotctl.planning.map.zone import Zone
from robotctl.planning.navigation_step import LoadRequest, NavigationInputs
from robotctl.planning.navigator import Navigator
from robotctl.safety.state_machine import POWERED

COMMAND_LIFE_PERIODS: Final = 4
"""Periods of the navigator after which a velocity command expires."""

STATE_MAX_AGE_NS: Final = 200_000_000
"""An older control state is not acted on [ns]."""

_Aside: TypeAlias = (
    ExternalPose | GroundStationPresence | SetFence | EnableFence | SetRally | SetZones | Tuning
)
"""Requests that are not for the navigator."""

_UNKNOWN: Final = SE2(math.nan, math.nan, math.nan)
"""Pose before the first control state: the navigator stands still and drops no breadcrumb."""


class _MissionFile(NamedTuple):
    """Path, CRC-32 and content of a mission's file; for the mission of the start content alone."""

    path: str
    crc: int
    content: bytes


class _Offer(NamedTuple):
    """A mission, or none, with the file that it is from."""

    mission: Mission | None
    path: str
    content: bytes


class NavigationAdapter:
    """Runs a `Navigator` on messages.

    Parameters
    ----------
    navigator, config
        The navigator and its settings.
    fence
        What keeps the robot within its fence.
    has_localiser
        Whether one is to be waited for.
    camera_rate_hz
        Pictures a second of the camera that watches the floor; 0: there is none.
    needs_station
        Whether it drives by itself only while a ground station is there.
    station_timeout_s
        Silence of a ground station that was there after which it goes to HOLD [s]; inf: never.
    mission_content
        File of the navigator's mission.
    places, links
        Places of the topological map for people, and the pairs of their numbers with a passage.

    Attributes
    ----------
    navigator, fence
        The navigator, and what keeps the robot within its fence.
    period_ns
        Of its steps [ns].
    """

    def __init__(
        self,
        navigator: Navigator,
        config: NavigationConfig,
        fence: FenceKeeper,
        *,
        has_localiser: bool,
        camera_rate_hz: float,
        needs_station: bool,
        station_timeout_s: float,
        mission_content: bytes = b"",
        places: tuple[KnownPlace, ...] = (),
        links: tuple[tuple[int, int], ...] = (),
    ) -> None:
        self.navigator = navigator
        self.fence = fence
        self.period_ns = round(1e9 / config.rate_hz)
        self._mission_file = _MissionFile("", 0, mission_content)
        self._rally: SetRally | None = None
        self._zones: tuple[DrawnZone, ...] = ()
        self._zones_crc = 0
        self._places, self._links = places, links
        self._told = ToldViews()
        self._offer: _Offer | None = None
        """A mission that the navigator is asked to take in this step."""
        self._sightings = Sightings(lambda: navigator.reach_over_m, camera_rate_hz)
        self._world = WorldPose(has_localiser=has_localiser)
        self._notices: list[str] = []
        self._message = ""
        self._armings: int | None = None
        """The count in the last state, None if that was not enabled."""
        self._station = StationWatch(needs_station=needs_station, timeout_s=station_timeout_s)
        self._views = PlanViews(navigator.outlook)

    def step(
        self,
        control: ControlState | None,
        localisation: LocalisationState | None,
        requests: Sequence[NavigationRequest],
        now_ns: int,
        seen: Sequence[LidarScan | CameraView] = (),
        late_ns: int = 0,
    ) -> tuple[VelocityCommand, NavigationState]:
        """Return the velocity command of this step and what to publish.

        A request for a mode or a position that waited for longer than `REQUEST_LIFE_NS`, because
        this process was held up, is dropped: whoever asked was told so and may have left the
        robot to others. HOLD is always taken; velocities and sticks expire by themselves.

        `localisation` is the localiser's last message. Where `WorldPose` has no pose, the robot
        looks around by odometry alone. `seen` is what lidar and camera saw since the last step,
        `late_ns` how long this process was kept from it [ns].
        """
        if localisation is not None:
            self._world.localise(localisation)
        self.bound_by(each for each in requests if not too_late(each, now_ns))
        inputs = self._inputs(control, requests, now_ns, seen)._replace(late_ns=late_ns)
        out = self.navigator.step(inputs, now_ns)
        offer, self._offer = self._offer, None
        if offer is not None and self.navigator.auto.mission is offer.mission:
            self._hold(offer.path, offer.content)
        until_ns = now_ns + COMMAND_LIFE_PERIODS * self.period_ns
        if out.expires_ns is not None:
            # Control brakes in the tick in which a set-point is void, not at the next step here.
            until_ns = min(until_ns, max(now_ns, out.expires_ns))
        wanted = Twist(out.v_m_s, out.omega_rad_s, out.vy_m_s)
        twist = self._within_fence(control, inputs, wanted, now_ns)
        command = VelocityCommand(now_ns, until_ns, *twist)
        if out.state.message != self._message and inputs.enabled and out.state.held:
            self._notices.append(out.state.message)
        self._message = out.state.message
        state = msgspec.structs.replace(
            out.state,
            message=self.fence.message or out.state.message,
            mission_file=self._mission_file.path,
            mission_crc=self._mission_file.crc,
            fence=self.fence.state,
            rally_crc=0 if self._rally is None else self._rally.crc,
        )
        return command, state

    def outside_body(self, seen: Sequence[SensorMessage]) -> tuple[SensorMessage, ...]:
        """Return what was seen, without echoes of a body that has several states.

        Of what always moves with the robot, the file says in which directions a lidar sees it.
        """
        sides = self.navigator.changing_sides
        if sides is None:
            return tuple(seen)
        return tuple(
            without_body(each, sides) if isinstance(each, LidarScan) else each for each in seen
        )

    def bound_by(self, requests: Iterable[NavigationRequest]) -> None:
        """Take fences, which planning keeps to, too, zones and rally points; leave all else."""
        before = self.fence.planned
        for each in requests:
            if isinstance(each, SetFence | EnableFence):
                self.fence.take(each)
            elif isinstance(each, SetRally):
                self.navigator.bounds.use_rally(each.places)
                self._rally = each
            elif isinstance(each, SetZones):
                self._draw(each)
        if self.fence.planned != before:
            self.navigator.bounds.use_fence(self.fence.planned)

    def _draw(self, request: SetZones) -> None:
        """Take the drawn zones, or give the reason for refusing them as a notice."""
        try:
            self.navigator.bounds.use_drawn_zones(
                [Zone(each.name, each.corners, each.speed_m_s) for each in request.zones]
            )
        except (MissionError, ValueError) as error:
            self._notices.append(f"zones refused: {error}")
            return
        self._zones, self._zones_crc = request.zones, request.crc
        self._notices.append(f"zones: {len(request.zones) or 'none'} drawn")

    def _within_fence(
        self, control: ControlState | None, inputs: NavigationInputs, wanted: Twist, now_ns: int
    ) -> Twist:
        """Return what of a velocity keeps to the fence."""
        if control is None or not inputs.enabled or not inputs.are_finite:
            return wanted
        pose = inputs.pose if self._world.is_sure(control) else None
        return self.fence.keep(control, pose, wanted, now_ns)

    def _inputs(
        self,
        control: ControlState | None,
        requests: Sequence[NavigationRequest],
        now_ns: int,
        seen: Sequence[LidarScan | CameraView],
    ) -> NavigationInputs:
        """Return the messages of a step as the navigator takes them."""
        wanted = [
            self._loaded(each) if isinstance(each, LoadMission) else translated(each)
            for each in self._in_time(requests, now_ns)
            if not isinstance(each, _Aside)
        ]
        taken = tuple(each for each in wanted if each is not None)
        self._station.note(requests)
        attended, lost = self._station.attends(now_ns), self._station.loses(now_ns)
        if control is None:
            self._armings = None
            return NavigationInputs(
                _UNKNOWN,
                Twist(0.0, 0.0),
                (),
                (),
                False,
                taken,
                True,
                attended,
                lost,
                control_is_fresh=False,
            )
        self._notices += self._sightings.take(control, seen, now_ns)
        known = self._world.pose(control)
        pose = control.T_odom_base if known is None else known
        fresh = now_ns - control.stamp_ns <= STATE_MAX_AGE_NS
        enabled = False
        if fresh and control.state in POWERED:
            enabled = self._armings in {None, control.armings}  # else stopped between two states
            self._armings = control.armings
        else:
            self._armings = None
        return NavigationInputs(
            pose=pose,
            twist=control.twist,
            ranges_m=control.sonar_m,
            received_ns=control.sonar_stamp_ns,
            enabled=enabled,
            localised=self._world.is_tracked(control),
            attended=attended,
            station_lost=lost,
            control_is_fresh=fresh,
            requests=taken,
            blind=self._sightings.blindness(now_ns),
            floor_base=self._sightings.floor_base,
            epoch=self._world.epoch(control),
            scans=self._sightings.scans(seen),
            T_world_odom=pose @ control.T_odom_base.inverse(),
            markers=self._sightings.markers(seen),
            charge=math.nan if control.battery is None else control.battery.charge,
        )

    def remember(self, mission: Mission, file: str, content: bytes) -> None:
        """Take a mission that was loaded before this process began.

        Raises
        ------
        MissionError
            If the robot cannot drive it.
        """
        self.navigator.auto.load(mission)
        self._hold(file, content)

    def _hold(self, file: str, content: bytes) -> None:
        """Note the file of the present mission."""
        self._mission_file = _MissionFile(file, zlib.crc32(content), content)

    def _loaded(self, message: LoadMission) -> LoadRequest | None:
        """Return the request for a mission; None if it is none, which its sender should know."""
        if not message.content:
            self._offer = _Offer(None, "", b"")
            return LoadRequest(None)
        try:
            mission = parse_mission(message.content.decode("utf-8-sig"), message.file)
        except (ConfigError, UnicodeDecodeError) as error:
            self._notices.append(f"mission refused: {error}")
            return None
        self._offer = _Offer(mission, message.file, message.content)
        return LoadRequest(mission)

    def views(self, now_ns: int) -> list[PlanView | Told]:
        """Return what the robot drives by and is told, if it is time for people to see it."""
        mission = MissionView(now_ns, *self._mission_file)
        return [*self._views.of(now_ns), *self._told.due(mission, self._bounds(now_ns))]

    def _bounds(self, now_ns: int) -> BoundsView:
        """Return what bounds the robot."""
        navigator, fence, rally = self.navigator, self.fence, self._rally
        of_mission = () if navigator.auto.mission is None else navigator.auto.mission.zone
        own = [*_drawn(navigator.bounds.own_zones, "robot"), *_drawn(of_mission, "mission")]
        home = navigator.home
        return BoundsView(
            now_ns,
            fence.fence,
            fence.state.crc,
            fence.state.enabled,
            (*own, *self._zones),
            self._zones_crc,
            () if rally is None else rally.places,
            0 if rally is None else rally.crc,
            (home.x_m, home.y_m, home.theta_rad),
            self._places,
            self._links,
        )

    def take_notices(self) -> list[str]:
        """Return sentences for people since the last call."""
        said = self.navigator.take_notices()
        notices, self._notices = [*self._notices, *said, *self.fence.take_notices()], []
        return notices

    def _in_time(
        self, requests: Sequence[NavigationRequest], now_ns: int
    ) -> list[NavigationRequest]:
        """Return the requests without those that came too late."""
        taken: list[NavigationRequest] = []
        late: list[NavigationRequest] = []
        for each in requests:
            (late if too_late(each, now_ns) else taken).append(each)
        if late:
            oldest_s = (now_ns - min(each.stamp_ns for each in late)) / 1e9
            what = "request" if len(late) == 1 else "requests"
            self._notices.append(
                f"{len(late)} {what} for a mode or position dropped: {oldest_s:.1f} s old"
            )
        return taken


def _drawn(zones: Sequence[Zone], origin: str) -> list[DrawnZone]:
    """Return zones of a file as a message."""
    return [DrawnZone(each.name, each.corners, each.speed_m_s, origin) for each in zones]
