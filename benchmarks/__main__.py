"""`python -m benchmarks [SUBJECT...]`: run all benchmarks, or some."""

from __future__ import annotations

import argparse
import sys
from functools import partial

from benchmarks import (
    camera_accuracy,
    camera_homography,
    camera_render,
    camera_step,
    control_quality,
    drive_missions,
    drives,
    ekf_cost,
    ekf_slam,
    exploration,
    flight_recorder,
    global_planning,
    graphs,
    grid_mapping,
    landmark_accuracy,
    lidar_slam,
    live_map,
    local_planning,
    localisation_accuracy,
    localisation_sonar,
    lockstep_speed,
    loop_lag,
    machine,
    map_worlds,
    mavlink_parameters,
    mavlink_stations,
    memory,
    navigation_step,
    odometry_calibration,
    paired_lockstep,
    place_recognition,
    replay,
    scan_lines,
    sensor_fit,
    sensor_models,
    slam_life,
    start_up,
    sweeps,
    tick_cost,
    topological_driving,
    visual_places,
    wall_following,
    web,
    web_page,
)

SUBJECTS = {
    "tick": tick_cost.run,
    "drives": drives.run,
    "drive-missions": drive_missions.run,
    "lag": loop_lag.run,
    "lockstep": lockstep_speed.run,
    "maps": map_worlds.run,
    "memory": memory.run,
    "recorder": flight_recorder.run,
    "control": control_quality.run,
    "startup": start_up.run,
    "grid": grid_mapping.run,
    "odometry": odometry_calibration.run,
    "ekf": ekf_cost.run,
    "ekf-slam": ekf_slam.run,
    "lidar-slam": lidar_slam.run,
    "slam-life": slam_life.run,
    "sweeps": sweeps.run,
    "landmarks": landmark_accuracy.run,
    "sensors": sensor_models.run,
    "sensor-fit": sensor_fit.run,
    "lines": scan_lines.run,
    "camera-sim": camera_render.run,
    "camera": camera_step.run,
    "camera-accuracy": camera_accuracy.run,
    "mcl": localisation_accuracy.run,
    "mcl-sonar": localisation_sonar.run,
    "places": place_recognition.run,
    "visual-places": visual_places.run,
    "graphs": graphs.run,
    "planning": global_planning.run,
    "local": local_planning.run,
    "navigation": navigation_step.run,
    "walls": wall_following.run,
    "exploring": exploration.run,
    "by-places": topological_driving.run,
    "layers": live_map.run,
    "mavlink": mavlink_parameters.run,
    "stations": mavlink_stations.run,
    "camera-homography": camera_homography.run,
    "page": web_page.run,
    "replay": replay.run,
    "web": web.run,
}


def main() -> int:
    """Run the command; figures never fail it."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument(
        "subjects",
        nargs="*",
        metavar="SUBJECT",
        help=f"{', '.join(SUBJECTS)}, paired; default: all",
    )
    parser.add_argument("--rounds", type=int, default=5, help="per figure (%(default)s)")
    parser.add_argument("--seconds", type=float, default=10.0, help="per round (%(default)s)")
    parser.add_argument(
        "--against",
        default="",
        metavar="REVISION",
        help="of `paired`: the commit that this tree is compared with; default: the last release",
    )
    options = parser.parse_args()
    subjects = {**SUBJECTS, "paired": partial(paired_lockstep.run, against=options.against)}
    unknown = [name for name in options.subjects if name not in subjects]
    if unknown:
        parser.error(f"{', '.join(unknown)}: unknown; there are {', '.join(subjects)}")
    machine.note(machine.describe())
    machine.note(f"command  python -m benchmarks {' '.join(sys.argv[1:])}".rstrip())
    stolen_s = machine.stolen_s()
    for name in options.subjects or subjects:
        subjects[name](max(1, options.rounds), max(2.0, options.seconds))
    stolen_s = machine.stolen_s() - stolen_s
    machine.note(f"\nload at the end {machine.load()}; {stolen_s:.2f} s stolen by the hypervisor")
    return 0


if __name__ == "__main__":
    sys.exit(main())
