"""The command drake-srg."""
