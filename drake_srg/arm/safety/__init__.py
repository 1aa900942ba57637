"""Limits that hold whatever commands an arm, and stops along its path."""
