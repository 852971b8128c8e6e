"""`robotctl map`."""
