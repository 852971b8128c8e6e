"""Twin of one axis of an ODrive, with firmware 0.5.6 or 0.6.x."""
