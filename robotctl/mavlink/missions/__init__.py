"""MAVLink missions: their items, and what they mean as a mission of ours."""
