"""`robotctl camera`."""
