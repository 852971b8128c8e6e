"""A square with round corners: the wheel speeds of two drives, and the pose that they give back.

python examples/drive_and_odometry.py
"""

import math

from robotctl.estimation.odometry.odometry import Odometry
from robotctl.model.drives.drives import AckermannDrive, DifferentialDrive
from robotctl.model.geometry.se2 import SE2

DRIVES = {
    "differential": DifferentialDrive("differential", 0.4, 0.08, counts_per_revolution=4096),
    "ackermann": AckermannDrive("ackermann", 0.35, 0.3, 0.08, 0.6, 1.5, 4096),
}
SPEED_M_S, RADIUS_M, STEP_S = 0.5, 0.8, 0.01
STRAIGHT = (0.0, 1.0 / SPEED_M_S)
CORNER = (SPEED_M_S / RADIUS_M, RADIUS_M * math.pi / 2 / SPEED_M_S)

for name, drive in DRIVES.items():
    odometry = Odometry(drive, SE2(0.0, 0.0, 0.0))
    first = second = 0.0  # angles of the wheels [rad]
    for omega_rad_s, duration_s in 4 * (STRAIGHT, CORNER):
        steps = round(duration_s / STEP_S)
        steering_rad = drive.inverse(SPEED_M_S, omega_rad_s).steering_rad
        wheels = drive.inverse(SPEED_M_S, omega_rad_s, steering_rad)
        for _ in range(steps):
            first += wheels.omega1_rad_s * duration_s / steps
            second += wheels.omega2_rad_s * duration_s / steps
            odometry.update(first, second, steering_rad)
    end = odometry.pose_odom_base
    print(f"{name}: {odometry.distance_m:.3f} m, ends at {end.x_m:+.4f} m, {end.y_m:+.4f} m")
