"""`robotctl places`."""
