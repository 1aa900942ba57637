"""The pick-and-place task: its modes, and the motions of each."""
