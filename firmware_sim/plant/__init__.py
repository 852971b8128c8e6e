"""The machine: motors, battery, body and its contact with walls."""
