"""Which commands count: copies, late ones and those of a link that was away."""
