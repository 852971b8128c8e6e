"""Twin of a moteus: registers and diagnostic stream over CAN FD."""
