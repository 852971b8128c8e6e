"""A square with round corners: the wheel speeds of three drives, and the pose that they give back.

python examples/drive_and_odometry.py
"""

import math

from robotctl.estimation import Odometry
from robotctl.model import SE2, AckermannDrive, DifferentialDrive, MecanumDrive, Twist

DRIVES = {
    "differential": DifferentialDrive("differential", 0.4, 0.08, counts_per_revolution=4096),
    "mecanum": MecanumDrive("mecanum", 0.3, 0.35, 0.08, counts_per_revolution=4096),
    "ackermann": AckermannDrive("ackermann", 0.35, 0.3, 0.08, 0.6, 1.5, 4096),
}
SPEED_M_S, RADIUS_M, STEP_S = 0.5, 0.8, 0.01
STRAIGHT = (0.0, 1.0 / SPEED_M_S)
CORNER = (SPEED_M_S / RADIUS_M, RADIUS_M * math.pi / 2 / SPEED_M_S)

for name, drive in DRIVES.items():
    odometry = Odometry(drive, SE2(0.0, 0.0, 0.0))
    angles_rad = [0.0] * len(drive.wheel_names)
    for omega_rad_s, duration_s in 4 * (STRAIGHT, CORNER):
        steps = round(duration_s / STEP_S)
        wanted = drive.inverse(Twist(SPEED_M_S, omega_rad_s))
        for _ in range(steps):
            for i, speed_rad_s in enumerate(wanted.wheels_rad_s):
                angles_rad[i] += speed_rad_s * duration_s / steps
            odometry.update(tuple(angles_rad), wanted.joints_rad)
    end = odometry.pose_odom_base
    print(f"{name}: {odometry.distance_m:.3f} m, ends at {end.x_m:+.4f} m, {end.y_m:+.4f} m")
