"""Messages between the parts of robotctl: typed values without behaviour."""
