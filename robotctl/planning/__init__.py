"""From goals and missions to velocity commands, without clock or I/O.

Data passes three rooms once, downwards, and a guard beside them:

- `map`: what is free, what moves, what it costs (`map.planning_map.PlanningMap`)
- `path`: paths through a map and following them (`path.global_planning.planners.PLANNERS`)
- `behave`: what to do about a goal or a mission (`behave.behaviours.registry.BEHAVIOURS`)
- `guard`: stopping before obstacles (`guard.obstacle_guard.ObstacleGuard`)

`navigator.Navigator` joins them to modes and steps.
"""
