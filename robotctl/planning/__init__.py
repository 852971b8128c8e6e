"""From goals and missions to velocity commands, without clock or I/O."""
