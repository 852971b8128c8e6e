"""Paths through a flat by three planners: their lengths, and how near they come to walls.

python examples/plan_on_a_map.py
"""

from robotctl.workbench import PlanOptions, make_plan

for planner in ("dijkstra", "astar", "hybrid"):
    options = PlanOptions("configs/worlds/flat.toml", (1.0, 1.0), (5.5, 4.0), planner)
    found = make_plan(options).report()
    print(f"{planner}: {found['length_m']:.2f} m long, {found['min_clearance_m']:.2f} m from walls")
