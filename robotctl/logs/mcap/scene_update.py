"""`foxglove.SceneUpdate`: entities drawn in a 3D panel, each until replaced by its `id`.

Names and fields are those of https://docs.foxglove.dev/docs/sdk/schemas/scene-update. Lengths are
in metres; `pose` is in the frame of the entity.
"""

from __future__ import annotations

import enum

import msgspec

from robotctl.logs.mcap.foxglove import AT_ORIGIN, Pose, Time, Vector3, time_of


class Duration(msgspec.Struct, frozen=True, gc=False):
    """A time span."""

    sec: int
    nsec: int


class Color(msgspec.Struct, frozen=True, gc=False):
    """Red, green, blue and opacity, each in [0, 1]."""

    r: float
    g: float
    b: float
    a: float


class KeyValuePair(msgspec.Struct, frozen=True, gc=False):
    """A fact about an entity, shown when it is selected."""

    key: str
    value: str


class ArrowPrimitive(msgspec.Struct, frozen=True, gc=False):
    """An arrow along x of its pose."""

    pose: Pose
    shaft_length: float
    shaft_diameter: float
    head_length: float
    head_diameter: float
    color: Color


class CubePrimitive(msgspec.Struct, frozen=True, gc=False):
    """A box around its pose."""

    pose: Pose
    size: Vector3
    color: Color


class SpherePrimitive(msgspec.Struct, frozen=True, gc=False):
    """A sphere or an ellipsoid around its pose."""

    pose: Pose
    size: Vector3
    color: Color


class CylinderPrimitive(msgspec.Struct, frozen=True, gc=False):
    """A cylinder along z of its pose, elliptical where x and y of its size differ."""

    pose: Pose
    size: Vector3
    bottom_scale: float
    top_scale: float
    color: Color


class LineType(enum.IntEnum):
    """Meaning of the points of a line."""

    LINE_STRIP = 0
    LINE_LOOP = 1
    LINE_LIST = 2


class LinePrimitive(msgspec.Struct, frozen=True):
    """A line through points; its thickness is in pixels if that is scale invariant."""

    type: LineType
    pose: Pose
    thickness: float
    scale_invariant: bool
    points: tuple[Vector3, ...]
    color: Color
    colors: tuple[Color, ...] = ()
    indices: tuple[int, ...] = ()


class TriangleListPrimitive(msgspec.Struct, frozen=True):
    """Triangles, three points each."""

    pose: Pose
    points: tuple[Vector3, ...]
    color: Color
    colors: tuple[Color, ...]
    indices: tuple[int, ...]


class TextPrimitive(msgspec.Struct, frozen=True, gc=False):
    """A text that faces the viewer if it is a billboard."""

    pose: Pose
    billboard: bool
    font_size: float
    scale_invariant: bool
    color: Color
    text: str


class ModelPrimitive(msgspec.Struct, frozen=True, gc=False):
    """A mesh from a file."""

    pose: Pose
    scale: Vector3
    color: Color
    override_color: bool
    url: str
    media_type: str
    data: bytes


class SceneEntity(msgspec.Struct, frozen=True):
    """An entity of primitives, replaced by the next of its topic with the same `id`.

    A lifetime of 0 does not end. `frame_locked`: it moves with its frame; else it stays at the
    frame's pose at its time.
    """

    timestamp: Time
    frame_id: str
    id: str
    lifetime: Duration
    frame_locked: bool
    metadata: tuple[KeyValuePair, ...] = ()
    arrows: tuple[ArrowPrimitive, ...] = ()
    cubes: tuple[CubePrimitive, ...] = ()
    spheres: tuple[SpherePrimitive, ...] = ()
    cylinders: tuple[CylinderPrimitive, ...] = ()
    lines: tuple[LinePrimitive, ...] = ()
    triangles: tuple[TriangleListPrimitive, ...] = ()
    texts: tuple[TextPrimitive, ...] = ()
    models: tuple[ModelPrimitive, ...] = ()


class SceneEntityDeletionType(enum.IntEnum):
    """Entities removed by a deletion: the one of its `id`, or all of the topic."""

    MATCHING_ID = 0
    ALL = 1


class SceneEntityDeletion(msgspec.Struct, frozen=True, gc=False):
    """Removal of entities that are older than it."""

    timestamp: Time
    type: SceneEntityDeletionType
    id: str


class SceneUpdate(msgspec.Struct, frozen=True):
    """Changes to what a topic draws; deletions come first."""

    deletions: tuple[SceneEntityDeletion, ...]
    entities: tuple[SceneEntity, ...]


def lasting(lifetime_ns: int) -> Duration:
    """Return a time span given in nanoseconds."""
    return Duration(*divmod(lifetime_ns, 1_000_000_000))


def draw(*entities: SceneEntity) -> SceneUpdate:
    """Return the update that shows entities."""
    return SceneUpdate((), entities)


def erase(wall_ns: int) -> SceneUpdate:
    """Return the update that removes all that a topic draws."""
    gone = SceneEntityDeletion(time_of(wall_ns), SceneEntityDeletionType.ALL, "")
    return SceneUpdate((gone,), ())


def line(
    kind: LineType, points: tuple[Vector3, ...], color: Color, pose: Pose = AT_ORIGIN
) -> LinePrimitive:
    """Return a line two pixels thick."""
    return LinePrimitive(kind, pose, 2.0, scale_invariant=True, points=points, color=color)


def label(pose: Pose, color: Color, text: str) -> TextPrimitive:
    """Return a text of 0.15 m that faces the viewer."""
    return TextPrimitive(
        pose, billboard=True, font_size=0.15, scale_invariant=False, color=color, text=text
    )
