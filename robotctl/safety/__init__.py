"""Reasons to stop: state machine, health, monitors and arming, pure.

Public names:

- `state_machine.SafetyMachine`, `state_machine.TRANSITIONS`, `state_machine.SafetyConfig`: states
  and their transitions
- `health.Health`, `supervision.Supervision`, `supervision.MONITORS`: ages of inputs, monitors, what
  speaks against arming
- `command_guard.guarded`: the last look at a command
"""
