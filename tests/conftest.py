"""Settings of all tests."""

from hypothesis import settings

# No deadline: the machine may be busy. The same examples every time: a change that
# passes here passes elsewhere.
settings.register_profile("drake_srg", deadline=None, derandomize=True)
settings.load_profile("drake_srg")
