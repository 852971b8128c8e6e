"""Free floor and obstacles from a camera's picture."""
