"""`robotctl plan`."""
