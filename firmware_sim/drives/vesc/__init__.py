"""Twin of a VESC: one motor, and the servo output."""
