"""Inserts pegs into tight holes with a compliant arm."""
