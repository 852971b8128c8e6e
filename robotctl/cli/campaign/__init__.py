"""`robotctl campaign`."""
