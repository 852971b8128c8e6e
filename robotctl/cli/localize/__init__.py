"""`robotctl localize`."""
