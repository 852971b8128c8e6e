"""The composition root: from a configuration to objects and processes.

Public names:

- `simulation.lockstep.run_lockstep`, `simulation.lockstep.LockstepRun`,
  `simulation.sim_options.SimOptions`: a robot in simulation, in one process
- `processes.robot.make_core`, `processes.robot.make_robot`: its parts, each from the configuration
"""
