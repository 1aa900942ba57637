"""Pegs into holes that are hardly wider, by an arm that yields."""
