"""Safety limits of an arm for any source of commands, and stops along its path."""
