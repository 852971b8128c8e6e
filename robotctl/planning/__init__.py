"""From goals and missions to velocity commands, without clock or I/O.

Public names:

- `navigator.Navigator`, `mission.mission_file.parse_mission`, `behaviours.registry.BEHAVIOURS`:
  modes, missions and what their items do
- `global_planning.planners.PLANNERS`, `costmap.planning_map.PlanningMap`: paths through a map
- `local.pursuit.Pursuit`, `guard.obstacle_guard.ObstacleGuard`: following a path, stopping before
  obstacles
"""
