"""`robotctl slam`."""
