"""The CAN bus: port, codec, end-to-end protection, errors and load."""
