"""The command `drake-srg`."""
