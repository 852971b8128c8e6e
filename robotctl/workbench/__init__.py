"""Offline work behind the commands: each takes its options and returns a result.

Public names:

- `tuning.tune.tune`, `odometry.calibrate_odometry.calibrate_odometry`,
  `sensors.characterise.characterise`: tuning and calibration
- `localize.localize.localize`, `localize.mapping.make_map`, `logs.export.export_csv`: recorded logs
- `planning.plan.make_plan`: paths
"""
