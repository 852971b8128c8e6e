"""The pure steps of control and navigation, put together once.

Public names:

- `control_core.ControlCore`, `checkpoint.checkpoint`, `checkpoint.restored`: the step of control,
  and its state as bytes
- `control_tick.ControlTick`, `navigation_tick.NavigationTick`, `operator.Operator`: one tick, in a
  process or in lockstep
"""
