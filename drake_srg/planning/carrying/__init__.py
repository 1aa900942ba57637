"""An object too wide for one hand, which two arms carry together."""
