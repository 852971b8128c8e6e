"""Twin of drives of CiA 402 over CANopen, with dialects of makers as settings."""
