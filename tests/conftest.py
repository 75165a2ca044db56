"""Settings of all tests."""

from __future__ import annotations

from hypothesis import settings

# A shared machine pauses now and then, and a failure must be found again by running again.
settings.register_profile("dsnet", deadline=None, derandomize=True)
settings.load_profile("dsnet")
