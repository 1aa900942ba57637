"""Visual servoing: images drive the hand to an object."""
