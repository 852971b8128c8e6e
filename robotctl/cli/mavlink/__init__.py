"""`robotctl mavlink`."""
