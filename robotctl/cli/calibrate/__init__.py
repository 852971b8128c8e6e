"""`robotctl calibrate`."""
