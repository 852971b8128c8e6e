"""Pure control laws: from a set-point and a measurement to a demand, without clock or I/O."""
