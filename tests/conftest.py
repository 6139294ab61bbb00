"""Settings that every test shares."""

from hypothesis import settings

# A deadline would time the machine, which runs tests side by side, and not the code.
settings.register_profile("eqt", deadline=None)
settings.load_profile("eqt")
