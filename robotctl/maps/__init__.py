"""Files of maps, places and worlds."""
