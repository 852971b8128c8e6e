"""A square driven with wheels that turn too far, and the one relation that closes it.

python examples/pose_graph.py
"""

import math

import numpy as np

from robotctl.estimation.slam import (
    BETWEEN_2D,
    SE2,
    SOLVERS,
    GraphBuilder,
    Problem,
    gauge,
    start_values,
)

relations = [(i, i + 1, (1.0, 0.0, math.pi / 2 + 0.1)) for i in range(4)]
relations.append((4, 0, (0.0, 0.0, 0.0)))  # the robot recognises where it began
builder = GraphBuilder()
for one, other, measured in relations:
    information = np.diag([100.0, 100.0, 400.0])
    builder.factors(BETWEEN_2D, np.array([[one, other]]), np.array([measured]), information[None])
graph, values, known = builder.build()
fixed = gauge(graph)
start = start_values(graph, values, known, fixed, "odometry")
found = SOLVERS["lm"](Problem(graph, start, fixed), lambda *_: None).values[SE2]
for name, poses in (("odometry", start[SE2]), ("optimum", found)):
    corners = ", ".join(f"({x:.2f}, {y:.2f})" for x, y, _ in poses)
    print(f"{name}: {corners}")
