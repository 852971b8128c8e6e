"""Requests of operators and ground stations to the navigator."""

from __future__ import annotations

from typing import Final, NamedTuple, TypeAlias

from robotctl.messages.mode import Mode

REQUEST_LIFE_NS: Final = 1_000_000_000
"""An older request for a mode or a position is not carried out [ns]; HOLD always is."""

FARTHEST_M: Final = 1e6
"""Bound of the coordinates of a position [m]; larger ones are mistakes."""


class ModeRequest(NamedTuple):
    """Change the mode."""

    mode: Mode
    stamp_ns: int | None = None
    """When it was asked for, monotonic [ns]; None: in the step that takes it."""


class VelocityRequest(NamedTuple):
    """GUIDED: drive with this velocity [m/s, rad/s] until `expires_ns`; see `VelocityTarget`."""

    expires_ns: int
    v_m_s: float
    omega_rad_s: float
    heading_rad: float | None = None
    """Direction of `world` to turn to and drive along [rad], in place of `omega_rad_s`."""
    vy_m_s: float = 0.0
    in_world: bool = False

    @property
    def needs_place(self) -> bool:
        """Whether it counts from directions of `world`."""
        return self.heading_rad is not None or self.in_world


class PositionRequest(NamedTuple):
    """GUIDED: drive to this point of `world` [m], to end with a heading [rad]; None: any."""

    x_m: float
    y_m: float
    heading_rad: float | None = None


class StickRequest(NamedTuple):
    """MANUAL: sticks in [-1, 1], forward, turn and sideways to the left, until `expires_ns`."""

    expires_ns: int
    forward: float
    turn: float
    sideways: float = 0.0


class ExploreRequest(NamedTuple):
    """GUIDED: drive to what is unknown until the map is complete."""


class PlaceRequest(NamedTuple):
    """GUIDED: drive to a place of the topological map."""

    place: str
    start: str = ""
    """Present place of the robot; empty: it recognises that."""


class GoAheadRequest(NamedTuple):
    """AUTO: go on with a mission that waits for an operator's word."""


class ReverseRequest(NamedTuple):
    """AUTO, GUIDED: drive to places in reverse, or ahead again, until the mode changes."""

    reverse: bool


class HomeRequest(NamedTuple):
    """RTL leads to this pose of `world` from now on [m, rad]."""

    x_m: float
    y_m: float
    theta_rad: float


class JumpRequest(NamedTuple):
    """Go on with another item of the mission: its number, counted from 1, or its name."""

    to: int | str


class AbortRequest(NamedTuple):
    """Give up the mission: stand, and start it again with the next AUTO."""


Request: TypeAlias = (
    ModeRequest
    | VelocityRequest
    | PositionRequest
    | StickRequest
    | ExploreRequest
    | PlaceRequest
    | GoAheadRequest
    | JumpRequest
    | ReverseRequest
    | HomeRequest
    | AbortRequest
)
"""Any of them; the application makes them from its messages."""


def on_earth(x_m: float, y_m: float) -> bool:
    """Say whether a point is finite and within 1000 km of the origin."""
    return abs(x_m) < FARTHEST_M and abs(y_m) < FARTHEST_M
