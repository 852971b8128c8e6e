"""The camera on the robot: pictures of its world.

    robot = load_robot(Path("configs/diff_drive.toml"))
    camera = Camera(robot, load_world(Path("configs/worlds/office.toml")), seed=1)
    view = camera.look(1.5, 7.5, 0.0)        # pose of base in world: m, m, rad
    view.picture                             # (height, width, 3) uint8, blue, green, red
    view.labels, view.distances              # the truth: what each pixel shows, and how far away

The world is 2.5-D: upright prisms on a level floor. Rays of pixels are computed once; for a picture
the plane about the camera is cut into sectors (`camera_fan`) and each ray with the candidates of
its sector (`camera_view`), exactly, so that a wall's foot is where the lens puts it. The floor's
pattern is filtered along the ray by how much of it a pixel covers. Light and shadows
come from lamps (`camera_light`) and are computed before the first picture. A picture depends only
on pose, seed and number: the same in lockstep and in real time.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from firmware_sim.camera.board import board_rows
from firmware_sim.camera.fan import Fan
from firmware_sim.camera.floor import (
    LEVELS,
    TEXEL_M,
    floor_laying,
    floor_texture,
    plaster_texture,
    print_texture,
)
from firmware_sim.camera.lens import PixelRays, pixel_rays
from firmware_sim.camera.light import floor_light
from firmware_sim.camera.marker import MarkerPainter
from firmware_sim.camera.scene import SHADE, make_scene
from firmware_sim.camera.view import FLOOR, NOTHING, PIXEL, QUANTILES, draw
from firmware_sim.config.camera_parameters import CameraMount, CameraParameters, Intrinsics
from firmware_sim.config.config import RobotConfig
from firmware_sim.errors import SimulationError
from firmware_sim.world.truth import Picture
from firmware_sim.world.world import World

MOST_SECTORS = 65_536
MOST_TAPS = 4
TAP_RATIO = 1.7
"""Maximum ratio of length to width of the patch of floor under one sample."""


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """A picture and the truth about each of its pixels.

    Attributes
    ----------
    picture
        (height, width, 3) uint8, blue, green, red.
    labels
        (height, width) int16: index in `World.things`; -1 floor; -2 nothing.
    distances
        Level distance from below the camera, (height, width) float32 [m]; inf: nothing.
    """

    picture: np.ndarray
    labels: np.ndarray
    distances: np.ndarray

    def framed(self, stamp_ns: int, sequence: int) -> Picture:
        """Return the picture as it is published, exposed at `stamp_ns` [ns]."""
        height, width, _ = self.picture.shape
        return Picture(stamp_ns, sequence, width, height, "bgr8", self.picture.tobytes())


class Camera:
    """Draws pictures of a world.

    Parameters
    ----------
    robot
        Robot with the table `[camera]`.
    world
        The room.
    seed
        Seed of the noise.

    Raises
    ------
    SimulationError
        If the robot has no camera, or an impossible one.
    """

    def __init__(self, robot: RobotConfig, world: World, seed: int = 0) -> None:
        if robot.camera is None:
            raise SimulationError(f"{robot.robot.name}: no table [camera]")
        self.parameters = robot.simulation.camera
        self._seed = seed
        try:
            self.intrinsics: Intrinsics = self.parameters.true_intrinsics(robot.camera.intrinsics)
            self.mount: CameraMount = self.parameters.true_mount(robot.camera.mount)
            rays = pixel_rays(self.intrinsics, self.mount)
        except ValueError as error:
            raise SimulationError(f"{robot.robot.name}: camera: {error}") from error
        sectors = min(max(8, round(2.0 * math.pi / rays.turn_rad)), MOST_SECTORS)
        self._turn_rad = rays.turn_rad
        self._pixels = _pixels(rays, sectors, self.mount.z_m, self.parameters)
        self._scene = make_scene(world)
        # After the things, what the negative labels stand for.
        self._shown = np.append(self._scene.thing, (NOTHING, FLOOR)).astype(np.int16)
        self._fan = Fan(self._scene, sectors, self.mount.z_m, float(rays.slope.max()))
        light = floor_light(world, self._scene, self.parameters.ambient)
        self._light = light.cells
        self._light_at = np.array([light.x_m, light.y_m, 1.0 / light.cell_m])
        self._boards = board_rows(world.boards)
        self._painter = MarkerPainter(
            world.markers, rays.ahead, rays.left, rays.slope, rays.turn_rad, self.mount.z_m
        )
        self._shade = np.ascontiguousarray(self._scene.sides[:, SHADE])
        floor = floor_texture(world.floor.texture, world.floor.seed)
        self._floor, self._starts = floor.texels, floor.starts
        self._laying = floor_laying(world.floor.texture, world.floor.seed)
        self._plaster = plaster_texture(world.floor.seed).texels
        self._prints = print_texture(world.floor.seed).texels
        # Light in units of a channel's value, 0 to 255.
        variance = self.parameters.read_noise**2 + self.parameters.shot_noise * np.arange(256.0)
        self._sigma = np.sqrt(variance).astype(np.float32)
        shares = (np.arange(QUANTILES) + 0.5) / QUANTILES
        normal = NormalDist()
        self._quantiles = np.array([normal.inv_cdf(share) for share in shares], dtype=np.float32)
        self._rows = np.zeros((4, 3 * self.intrinsics.width_px), dtype=np.float32)

    def look(self, x_m: float, y_m: float, theta_rad: float, number: int = 0) -> View:
        """Return the view from a pose of base in world; `number` of the picture draws its noise."""
        mount, scene, fan = self.mount, self._scene, self._fan
        x, y, heading = self.turn(x_m, y_m, theta_rad)
        shape = self._pixels.shape
        labels = np.empty(shape, dtype=np.int32)
        distances = np.empty(shape, dtype=np.float32)
        picture = np.empty((*shape, 3), dtype=np.uint8)
        draw(
            np.array([x, y, math.cos(heading), math.sin(heading)]),
            mount.z_m,
            self._turn_rad,
            self._pixels,
            fan.local,
            scene.first,
            scene.count,
            scene.height,
            scene.colour,
            self._shade,
            fan.near,
            fan.thing,
            fan.side,
            fan.listed,
            self._floor,
            self._laying.size,
            self._laying.shift,
            self._laying.cut,
            self._plaster,
            self._prints,
            scene.prints.slots,
            scene.prints.first,
            scene.prints.per_m,
            self._starts,
            self._light,
            self._light_at,
            self._boards,
            0.5 * self.parameters.blur_px**2,
            self._sigma,
            self._quantiles,
            self._key(number),
            self._rows,
            labels,
            distances,
            picture.reshape(shape[0], -1),
        )
        rng = np.random.default_rng(self._key(number))
        self._painter.paint(picture, distances, (x, y, heading), self._pixels["gain"], rng)
        return View(picture, self._shown[labels], distances)

    def turn(self, x_m: float, y_m: float, theta_rad: float) -> tuple[float, float, float]:
        """Fill the sectors from a pose of base; return below the camera x, y [m], heading [rad]."""
        mount = self.mount
        cos, sin = math.cos(theta_rad), math.sin(theta_rad)
        x = x_m + cos * mount.x_m - sin * mount.y_m
        y = y_m + sin * mount.x_m + cos * mount.y_m
        heading = theta_rad + math.radians(mount.yaw_deg)
        self._fan.turn(x, y, heading)
        return x, y, heading

    def _key(self, number: int) -> int:
        """Start of the stream of noise of one picture, in 63 bits."""
        words = np.random.SeedSequence([self._seed, number]).generate_state(1, np.uint64)
        return int(words[0] >> np.uint64(1))


def _pixels(
    rays: PixelRays, sectors: int, height_m: float, parameters: CameraParameters
) -> np.ndarray:
    """Return the properties of each pixel, (height, width) of `PIXEL`."""
    pixels = np.zeros(rays.slope.shape, dtype=PIXEL)
    pixels["ahead"], pixels["left"], pixels["slope"] = rays.ahead, rays.left, rays.slope
    azimuth = np.arctan2(rays.left, rays.ahead)
    pixels["sector"] = np.clip(
        np.floor((azimuth + math.pi) * (sectors / (2.0 * math.pi))), 0, sectors - 1
    )
    floor = np.full(rays.slope.shape, np.inf)
    down = rays.slope < 0.0
    floor[down] = -height_m / rays.slope[down]
    pixels["floor"] = floor
    # A pixel covers an ellipse of the floor, long along the ray.
    reach = np.hypot(floor, height_m)
    across = reach * rays.turn_rad
    along = across * reach / height_m
    with np.errstate(invalid="ignore"):
        taps = np.clip(np.rint(np.where(down, along / across, 1.0) / TAP_RATIO), 1, MOST_TAPS)
        size = np.maximum(across, along / taps)
        # Between two copies of the floor every pixel takes one or the other, at a fixed chance.
        dither = np.random.default_rng(0).random(rays.slope.shape)
        level = np.where(down, np.floor(np.log2(size / TEXEL_M) + dither), 0.0)
        pixels["step"] = np.where(down, along / taps, 0.0)
    pixels["taps"] = taps
    pixels["level"] = np.clip(level, 0, LEVELS - 1)
    pixels["gain"] = parameters.exposure * _vignette(rays.slope.shape, parameters.vignetting)
    return pixels


def _vignette(shape: tuple[int, ...], loss: float) -> np.ndarray:
    """Share of the light that reaches each pixel: 1 - loss in the corners, as the fourth power."""
    height, width = shape
    u, v = np.meshgrid(np.arange(width) - (width - 1) / 2, np.arange(height) - (height - 1) / 2)
    r2 = (u * u + v * v) / (width * width / 4 + height * height / 4)
    # cos^4 of an angle whose tangent grows with the radius.
    tangent2 = (1.0 - loss) ** -0.5 - 1.0
    share: np.ndarray = 1.0 / (1.0 + tangent2 * r2) ** 2
    return share
