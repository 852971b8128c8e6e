"""The robot's nodes on CAN: commissioning, SDO, feedback and commands."""
