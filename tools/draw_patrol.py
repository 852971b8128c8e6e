"""Draw `docs/patrol.png`: a patrol in lockstep, its path on the map and what the wheels did."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np

from robotctl.app.simulation.lockstep import LockstepRun
from robotctl.app.simulation.sim_options import SimOptions
from robotctl.config.robot_file import find_file
from robotctl.maps.world import load_walls

TARGET = Path(__file__).parents[1] / "docs" / "patrol.png"


def main() -> None:
    """Drive the patrol of the default robot and save the picture."""
    mpl.use("Agg")
    run = LockstepRun(SimOptions(find_file("diff_drive"), find_file("patrol", "missions")))
    rows, truths, items = [], [], {}
    for control, navigation in run.steps():
        truth = run.stack.simulation.truth()
        time_s = control.stamp_ns * 1e-9
        truths.append((truth.x_m, truth.y_m))
        rows.append(
            (time_s, control.x_m, control.y_m, *control.wheel_ref_rad_s, *control.wheel_rad_s)
        )
        items.setdefault(navigation.item_name, (time_s, control.x_m, control.y_m))
    time_s, x_m, y_m, left_ref, right_ref, left, right = np.array(rows).T
    figure, (plan, wheels) = plt.subplots(
        1, 2, figsize=(12, 4.2), width_ratios=(1.25, 1), layout="constrained"
    )
    for x1, y1, x2, y2 in load_walls(find_file("flat", "worlds")).segments:
        plan.plot((x1, x2), (y1, y2), color="black", linewidth=2)
    plan.plot(*np.array(truths).T, color="tab:orange", linewidth=4, alpha=0.5, label="true path")
    plan.plot(x_m, y_m, color="tab:blue", linewidth=1, label="odometry")
    for number, (name, (_, at_x, at_y)) in enumerate(items.items()):
        above_m = 0.12 if number % 2 == 0 else -0.22
        plan.annotate(name, (at_x, at_y), (at_x + 0.1, at_y + above_m), fontsize=8)
    plan.set_aspect("equal")
    plan.set(xlabel="x [m]", ylabel="y [m]", title="patrol in the flat")
    plan.legend(loc="upper right", fontsize=8)
    for reference, measured, colour, name in (
        (left_ref, left, "tab:blue", "left"),
        (right_ref, right, "tab:red", "right"),
    ):
        wheels.plot(time_s, measured, color=colour, linewidth=1, label=name)
        wheels.plot(time_s, reference, color="black", linewidth=0.6, linestyle=":")
    wheels.set(xlabel="time [s]", ylabel="wheel speed [rad/s]", title="wheels (dotted: reference)")
    wheels.legend(loc="lower right", fontsize=8)
    figure.savefig(TARGET, dpi=110)


if __name__ == "__main__":
    main()
