"""A robot's file: reading, checking and changing it.

Public names:

- `robot_file.load_robot`, `robot_file.RobotConfig`, `robot_file.find_file`: read and checked, with
  settings on top
"""
