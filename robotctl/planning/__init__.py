"""From goals and missions to velocity commands, without clock or I/O.

Data passes three rooms once, downwards: `map` (what is free, what moves, what it costs), `path`
(finding paths and following them), `behave` (what to do about a goal); `guard` stops the robot.

Public names:

- `navigator.Navigator`, `behave.mission.mission_file.parse_mission`: modes and missions
- `behave.behaviours.registry.BEHAVIOURS`: what the items of a mission do
- `path.global_planning.planners.PLANNERS`, `map.planning_map.PlanningMap`: paths through a map
- `path.local.pursuit.Pursuit`, `guard.obstacle_guard.ObstacleGuard`: following a path, stopping
  before obstacles
"""
