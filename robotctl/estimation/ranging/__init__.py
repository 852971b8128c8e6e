"""Expected readings of a range sensor in a known map, and their likelihood."""
