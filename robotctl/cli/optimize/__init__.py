"""`robotctl optimize`."""
