"""`python -m firmware_sim.camera.snapshot`: pictures of a world from given or drawn poses.

Writes for each pose NAME-000.png, and NAME-000.png in the folder `labels` beside it (16 bits: 0
nothing, 1 floor, 2 and on the things of the world in their order), and NAME.json with the truth:
poses, the true camera, the range to the nearest object in each direction, and the objects in the
picture.
"""

from __future__ import annotations

import argparse
import json
import math
import struct
import sys
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from firmware_sim.camera.truth import sightings, true_ranges
from firmware_sim.command_line import POSE, WORLD, Parser, file_among, parse_natural, parse_pose
from firmware_sim.config.config import RobotConfig, load_robot, parse_override
from firmware_sim.errors import SimulationError
from firmware_sim.world.world import World, load_world

BEAMS = 121
_HALF_FAN_RAD = math.radians(60.0)
_TRIALS = 10_000
"""Maximum trials for each pose."""


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    result = Parser(
        prog="python -m firmware_sim.camera.snapshot",
        description="Write what the robot's camera sees, and the truth about it.",
    )
    add = result.add_argument
    add("--robot", type=file_among("", ".toml"), required=True, help="TOML of the robot, or a name")
    add("--world", type=WORLD, required=True, help="TOML of the room or a ROS map.yaml, or a name")
    add("--set", action="append", default=[], metavar="KEY=VALUE", help="replace one value")
    add("--pose", action="append", type=parse_pose, default=[], metavar=POSE, help="of base")
    add("--random", type=parse_natural, default=0, metavar="N", help="more, where there is room")
    add("--seed", type=parse_natural, default=0, help="of noise and poses (%(default)s)")
    add("--out", type=Path, required=True, metavar="NAME", help="beginning of the files' names")
    return result


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the pictures; return 0, or 2 on bad input."""
    options = parser().parse_args(arguments)
    try:
        _write_all(options)
    except (SimulationError, OSError) as error:
        sys.stderr.write(f"{error}\n")
        return 2
    return 0


def png(image: np.ndarray) -> bytes:
    """Encode (height, width, 3) uint8 blue, green, red, or (height, width) grey of 8 or 16 bits."""
    height, width = image.shape[:2]
    rows = image[..., ::-1] if image.ndim == 3 else image.astype(image.dtype.newbyteorder(">"))
    # Each row begins with the number of its filter: 0, none.
    pixels = np.ascontiguousarray(rows).reshape(height, -1).view(np.uint8)
    data = np.hstack([np.zeros((height, 1), np.uint8), pixels]).tobytes()
    colour, bits = 2 if image.ndim == 3 else 0, 8 * image.itemsize
    header = struct.pack(">IIBBBBB", width, height, bits, colour, 0, 0, 0)
    chunks = ((b"IHDR", header), (b"IDAT", zlib.compress(data, 6)), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
        for kind, body in chunks
    )


def _write_all(options: argparse.Namespace) -> None:
    # Loading numba takes a second, which `--help` need not wait for.
    from firmware_sim.camera.camera import Camera  # noqa: PLC0415

    robot = load_robot(options.robot, dict(parse_override(text) for text in options.set))
    world = load_world(options.world)
    poses: list[tuple[float, float, float]] = list(options.pose)
    poses += _free_poses(robot, world, options.random, options.seed)
    if not poses:
        raise SimulationError(f"no pose: give --pose {POSE} or --random N")
    camera = Camera(robot, world, options.seed)
    folder = options.out.parent
    (folder / "labels").mkdir(parents=True, exist_ok=True)
    angles_rad = math.radians(camera.mount.yaw_deg) + np.linspace(
        -_HALF_FAN_RAD, _HALF_FAN_RAD, BEAMS
    )
    pictures: list[dict[str, Any]] = []
    for number, pose in enumerate(poses):
        view = camera.look(*pose, number=number)
        name = f"{options.out.name}-{number:03d}.png"
        (folder / name).write_bytes(png(view.picture))
        (folder / "labels" / name).write_bytes(png((view.labels + 2).astype(np.uint16)))
        seen = sightings(world, pose, camera.intrinsics, camera.mount)
        pictures.append(
            {
                "file": name,
                "pose": {"x_m": pose[0], "y_m": pose[1], "theta_rad": pose[2]},
                "ranges_m": _finite(true_ranges(world, pose, camera.mount, angles_rad)),
                "things": [asdict(each) for each in seen],
            }
        )
    truth = {
        "robot": str(options.robot),
        "world": str(options.world),
        "camera": {"intrinsics": asdict(camera.intrinsics), "mount": asdict(camera.mount)},
        "angles_rad": angles_rad.tolist(),
        "pictures": pictures,
    }
    options.out.with_name(f"{options.out.name}.json").write_text(
        json.dumps(truth, indent=1), encoding="utf-8"
    )


def _free_poses(
    robot: RobotConfig, world: World, count: int, seed: int
) -> Iterator[tuple[float, float, float]]:
    """Yield poses at which the robot can stand."""
    from firmware_sim.plant.plant import Plant  # noqa: PLC0415 - loads numba

    rng = np.random.default_rng([seed, 5])
    plant = Plant(robot, world, rng)
    low_x, low_y, high_x, high_y = world.bounds
    for found in range(count):
        for _ in range(_TRIALS):
            pose = (
                float(rng.uniform(low_x, high_x)),
                float(rng.uniform(low_y, high_y)),
                float(rng.uniform(-math.pi, math.pi)),
            )
            if not world.is_known(*pose[:2]):
                continue
            try:
                plant.place(*pose)
            except SimulationError:
                continue
            yield pose
            break
        else:
            raise SimulationError(
                f"--random {count}: no room was found for pose {found + 1} in {_TRIALS} draws"
            )


def _finite(ranges_m: np.ndarray) -> list[float | None]:
    """Ranges for JSON, which has no infinity: None if there is nothing."""
    return [float(each) if math.isfinite(each) else None for each in ranges_m]


if __name__ == "__main__":
    sys.exit(main())
