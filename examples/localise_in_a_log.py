"""Monte Carlo localisation of a recorded drive, from an unknown start in a known flat, and a plot.

python examples/localise_in_a_log.py examples/data/patrol.log.gz path.png
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from robotctl.estimation import LikelihoodField, MclConfig, MonteCarloLocaliser
from robotctl.estimation.grid.wall_raster import grid_of_walls
from robotctl.estimation.mcl.free_space import free_poses
from robotctl.logs import read_recording
from robotctl.maps import load_walls
from robotctl.model.geometry.localisation import LocalisationStatus

log_file, plot_file = sys.argv[1:] if len(sys.argv) == 3 else sys.exit(__doc__)
log = read_recording(Path(log_file))
walls = load_walls(Path("configs/worlds/flat.toml"))
grid = grid_of_walls(walls)
field = LikelihoodField(grid)
localiser = MonteCarloLocaliser(MclConfig(), free_poses(grid), np.random.default_rng(1))
found, before = [], log.scans[0].odometry
for entry in log.scans:
    localiser.move(before.inverse() @ entry.odometry)
    before = entry.odometry
    if localiser.due():
        localiser.measure(field.measurement(entry.scan))
    estimate = localiser.estimate(entry.scan.stamp_ns)
    if estimate.status is LocalisationStatus.LOCALISED:
        found.append((estimate.pose.x_m, estimate.pose.y_m))
print(f"localised in {len(found)} of {len(log.scans)} scans, last at {found[-1]}")
axes = Figure(figsize=(6, 5)).add_subplot(aspect="equal", xlabel="x [m]", ylabel="y [m]")
axes.plot(walls.segments[:, ::2].T, walls.segments[:, 1::2].T, "k")
axes.plot(*np.transpose(found))
axes.figure.savefig(plot_file)
