"""Our own motor controller: two channels and a steering servo, described in `configs/robot.dbc`."""
