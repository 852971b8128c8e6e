"""MAVLink links: UDP, TCP and serial."""
