"""A drive through a room that no other looks like, written as a CARMEN log with its map."""

import math

import numpy as np

WALLS = np.array(
    [
        (0, 0, 8, 0), (8, 0, 8, 5), (8, 5, 5, 5), (5, 5, 5, 3), (5, 3, 4, 3), (4, 3, 4, 6),
        (4, 6, 0, 6), (0, 6, 0, 0), (1.5, 2, 2, 2), (2, 2, 2, 2.5), (6.5, 1.0, 7.0, 1.5),
    ],
    float,
)  # fmt: skip
BEAMS = 181
SIDE_M = 0.05


def seen(x, y, theta):
    """Return the ranges of 181 beams by the intersection of each with each wall."""
    angles = theta + np.radians(np.arange(BEAMS) - 90.0)
    ranges = np.full(BEAMS, 81.91)
    for x1, y1, x2, y2 in WALLS:
        c, s, dx, dy = np.cos(angles), np.sin(angles), x2 - x1, y2 - y1
        across = c * dy - s * dx
        with np.errstate(divide="ignore", invalid="ignore"):
            along = ((x1 - x) * dy - (y1 - y) * dx) / across
            share = ((x1 - x) * s - (y1 - y) * c) / across
        hit = (along > 0.0) & (share >= 0.0) & (share <= 1.0)
        ranges = np.where(hit & (along < ranges), along, ranges)
    return ranges


def driven(steps):
    """Return true poses, and an odometry that drifts and begins elsewhere."""
    truth, odometry = [(3.0, 1.0, 0.0)], [(-3.0, 2.0, 1.0)]
    for i in range(1, steps):
        distance, turn = 0.2, 0.25 + 0.03 * math.sin(0.4 * i)
        for poses, scale, drift in ((truth, 1.0, 0.0), (odometry, 1.03, 0.004)):
            x, y, theta = poses[-1]
            half = theta + 0.5 * (turn + drift)
            way = scale * distance
            poses.append((x + way * math.cos(half), y + way * math.sin(half), theta + turn + drift))
    return truth, odometry


def write_drive(path, steps=60, seed=7):
    """Write the log; return its true poses."""
    rng = np.random.default_rng(seed)
    truth, odometry = driven(steps)
    lines = []
    for i, (pose, odom) in enumerate(zip(truth, odometry, strict=True)):
        ranges = seen(*pose)
        ranges = np.where(ranges < 80.0, ranges + 0.01 * rng.standard_normal(BEAMS), ranges)
        words = [f"FLASER {BEAMS}", *(f"{value:.3f}" for value in ranges)]
        words += [f"{value:.6f}" for value in (*pose, *odom)]
        lines.append(" ".join([*words, f"{100 + 0.5 * i:.6f} host 0.0"]))
    path.write_text("\n".join(lines) + "\n")
    return np.array(truth)


def write_map(folder, walls=WALLS):
    """Draw the walls as cells; return the path of the yaml file."""
    columns, rows = round(9.0 / SIDE_M), round(7.0 / SIDE_M)
    image = np.full((rows, columns), 254, np.uint8)
    for x1, y1, x2, y2 in walls:
        share = np.linspace(0.0, 1.0, 500)
        column = np.floor((x1 + share * (x2 - x1) + 0.5) / SIDE_M).astype(int)
        row = np.floor((y1 + share * (y2 - y1) + 0.5) / SIDE_M).astype(int)
        image[rows - 1 - row, column] = 0
    (folder / "room.pgm").write_bytes(f"P5\n{columns} {rows}\n255\n".encode() + image.tobytes())
    path = folder / "room.yaml"
    path.write_text(
        f"image: room.pgm\nresolution: {SIDE_M}\norigin: [-0.5, -0.5, 0.0]\n"
        "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    return path
