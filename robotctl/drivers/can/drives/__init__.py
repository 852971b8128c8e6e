"""Motor drives on the CAN bus: a folder each."""
