"""`robotctl localise`."""
