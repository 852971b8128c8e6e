"""Who is there, and what they ask for."""
