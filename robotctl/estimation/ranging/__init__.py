"""What a range sensor reads in a known map, and how likely a reading is."""
