"""ODrive motor drives with firmware 0.5 or 0.6, one axis a node, by their protocol CANSimple."""
