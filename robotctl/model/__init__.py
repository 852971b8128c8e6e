"""Typed, pure maths: poses, drive kinematics, motion and its noise.

Public names:

- `geometry.se2.SE2`, `geometry.se3.SE3`, `geometry.twist.Twist`,
  `geometry.pose_estimate.PoseEstimate`: poses in the plane and in space; a velocity; a pose with
  covariance
- `drives.drives.DifferentialDrive`, `drives.drives.TricycleDrive`, `drives.drives.AckermannDrive`:
  kinematics of a drive
- `drives.motion.integrate`, `drives.motion.arc`: motion along arcs
- `sensors.range_scan.RangeScan`, `sensors.sonar.SonarMount`: what lidars and sonars measure, and
  from where
- `grid_map.GridMap`, `wall_map.WallMap`, `trajectory.Trajectory`, `recording.Recording`: maps;
  poses over time; a recorded drive
"""
