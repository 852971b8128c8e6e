"""The ports of the runtime on real wires: CAN bus, motor controllers, sensors, MAVLink links."""
