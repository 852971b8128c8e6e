"""What the parts of robotctl tell each other: typed values without behaviour."""
