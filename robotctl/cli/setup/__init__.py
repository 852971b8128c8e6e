"""`robotctl setup`."""
