"""Work with a running robot over MAVLink, behind `robotctl mavlink`."""
