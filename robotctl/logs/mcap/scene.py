"""Data of a run in every log file, so that a viewer can show each file alone."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Final

from robotctl.estimation.ranging.sonar_config import SonarModelConfig
from robotctl.logs.mcap.drawings import Drawings
from robotctl.logs.mcap.foxglove import (
    BASE,
    CAMERA,
    LIDAR,
    ODOM,
    WORLD,
    FrameTransform,
    FrameTransforms,
    PoseInFrame,
    Quaternion,
    Vector3,
    planar_transform,
    pose_in,
    time_of,
)
from robotctl.messages.control import ControlState
from robotctl.messages.estimation import LidarScan, LiveMap, LocalisationState
from robotctl.messages.world_pose import WorldPose
from robotctl.model.footprint import Footprint
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.camera import CameraMount
from robotctl.model.sensors.sonar import SonarMount

_SONAR: Final = "sonar_"
"""Frame of a sonar, before its name."""


class Scene:
    """Frames and maps of a robot.

    Attributes
    ----------
    maps
        Newest map of each topic.
    drawings
        Drawings of the messages.

    Parameters
    ----------
    sonars
        Sonars, in the order of their ranges.
    camera
        Mount of the camera; None: there is none, or it is off.
    sonar
        Beam and range of the sonars.
    bodies, state
        Body of the robot in each of its states, and the present one; none: unknown.
    has_localiser
        Whether there is a transform from `odom` to `world`; without one the two are the same.
    """

    def __init__(
        self,
        sonars: Sequence[SonarMount] = (),
        camera: CameraMount | None = None,
        *,
        sonar: SonarModelConfig | None = None,
        bodies: Sequence[Footprint] = (),
        state: int = 0,
        has_localiser: bool = False,
    ) -> None:
        self.sonar_names = tuple(mount.name for mount in sonars)
        self.maps: dict[str, LiveMap] = {}
        self.drawings = Drawings(sonars, sonar or SonarModelConfig(), bodies, state)
        self._sonars = tuple(sonars)
        self._camera = camera
        self._lidars: dict[str, SE2] = {}
        self._world = WorldPose(has_localiser=has_localiser)

    def localise(self, state: LocalisationState) -> None:
        """Update the pose of `odom`."""
        self._world.localise(state)

    def place_lidar(self, scan: LidarScan) -> bool:
        """Update a lidar's mounting, known only from its scans; return whether it is new."""
        place = SE2(scan.x_m, scan.y_m)
        is_new = place != self._lidars.get(scan.name)
        self._lidars[scan.name] = place
        return is_new

    def frames(
        self, wall_ns: int, state: ControlState
    ) -> tuple[FrameTransforms, PoseInFrame | None]:
        """Return the transforms of `world`, `odom` and `base`, and `base` in `world` if known."""
        odom = planar_transform(wall_ns, ODOM, BASE, state.T_odom_base)
        T_world_odom, pose_world = self._world.T_world_odom(state), self._world.pose(state)
        if T_world_odom is None or pose_world is None:
            return FrameTransforms((odom,)), None
        world = planar_transform(wall_ns, WORLD, ODOM, T_world_odom)
        pose = pose_in(wall_ns, WORLD, pose_world)
        return FrameTransforms((world, odom)), pose

    def sensor_frames(self, wall_ns: int) -> FrameTransforms | None:
        """Return the sensor mounting in `base`; None if there are none."""
        found = _sonar_transforms(wall_ns, self._sonars)
        if self._camera is not None:
            found.append(camera_transform(wall_ns, self._camera))
        for name, place in self._lidars.items():
            frame = f"{LIDAR}_{name}" if name else LIDAR
            found.append(planar_transform(wall_ns, BASE, frame, place))
        return FrameTransforms(tuple(found)) if found else None


def _sonar_transforms(wall_ns: int, mounts: Iterable[SonarMount]) -> list[FrameTransform]:
    """Return the sonars' transforms in `base`; x of each frame is the sonar's axis."""
    return [
        planar_transform(
            wall_ns, BASE, f"{_SONAR}{each.name}", SE2(each.x_m, each.y_m, each.heading_rad)
        )
        for each in mounts
    ]


def sonar_mounts(frames: Iterable[FrameTransform]) -> tuple[SonarMount, ...]:
    """Return the sonars' mounts from the sensors' frames, in their order."""
    return tuple(
        SonarMount(
            each.child_frame_id.removeprefix(_SONAR),
            each.translation.x,
            each.translation.y,
            math.degrees(2.0 * math.atan2(each.rotation.z, each.rotation.w)),
        )
        for each in frames
        if each.child_frame_id.startswith(_SONAR)
    )


def camera_transform(wall_ns: int, mount: CameraMount) -> FrameTransform:
    """Return the camera's transform in `base`; its frame has z ahead, x right and y down."""
    yaw, pitch, roll = (
        0.5 * math.radians(angle) for angle in (mount.yaw_deg, mount.pitch_deg, mount.roll_deg)
    )
    rotation = Quaternion(0.0, 0.0, math.sin(yaw), math.cos(yaw))
    rotation = _product(rotation, Quaternion(0.0, math.sin(pitch), 0.0, math.cos(pitch)))
    rotation = _product(rotation, Quaternion(math.sin(roll), 0.0, 0.0, math.cos(roll)))
    # From x ahead, y left, z up to the frame of a picture.
    rotation = _product(rotation, Quaternion(-0.5, 0.5, -0.5, 0.5))
    place = Vector3(mount.x_m, mount.y_m, mount.z_m)
    return FrameTransform(time_of(wall_ns), BASE, CAMERA, place, rotation)


def _product(a: Quaternion, b: Quaternion) -> Quaternion:
    """Return the rotation by b followed by the one by a."""
    return Quaternion(
        a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y,
        a.w * b.y - a.x * b.z + a.y * b.w + a.z * b.x,
        a.w * b.z + a.x * b.y - a.y * b.x + a.z * b.w,
        a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z,
    )
