"""Settings of all tests."""

from __future__ import annotations

import signal

import pytest
from hypothesis import settings
from xdist.remote import Producer
from xdist.scheduler import LoadScopeScheduling

# A shared machine pauses now and then, and a failure must be found again by running again.
settings.register_profile("dsnet", deadline=None, derandomize=True)
settings.load_profile("dsnet")
# Shells start what they put into the background deaf to Ctrl-C, and its children are born so.
signal.signal(signal.SIGINT, signal.default_int_handler)


class FolderScheduling(LoadScopeScheduling):
    """Gives each folder to one process: its tests share what is slow to make, such as a run."""

    def _split_scope(self, nodeid: str) -> str:
        return nodeid.partition("::")[0].rpartition("/")[0]


def pytest_xdist_make_scheduler(config: pytest.Config, log: Producer) -> FolderScheduling:
    """Take that scheduler, whatever `--dist` says."""
    return FolderScheduling(config, log)
