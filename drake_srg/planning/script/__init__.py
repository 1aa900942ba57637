"""Fixed scripts and message sequences in place of a planner."""
