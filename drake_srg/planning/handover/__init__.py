"""An object that one arm gives and another one takes, in the air."""
