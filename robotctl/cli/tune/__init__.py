"""`robotctl tune`."""
