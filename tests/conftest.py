"""Settings of all tests."""

from hypothesis import settings

# A busy machine makes single examples slow; pytest's time-out still ends a test that hangs.
settings.register_profile("robotctl", deadline=None)
settings.load_profile("robotctl")
