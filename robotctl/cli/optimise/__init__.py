"""`robotctl optimise`."""
