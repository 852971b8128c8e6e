"""Clock, loop, safety state machine, messages and recorder."""
