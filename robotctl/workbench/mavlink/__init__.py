"""What is done with a running robot over MAVLink, behind `robotctl mavlink`."""
