"""Visual servoing: images drive the hand until it stands before an object."""
