"""Learning places and judging them."""
