"""Settings of all tests."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from hypothesis import settings
from xdist.remote import Producer
from xdist.scheduler import LoadScopeScheduling

from bridge.body import BodyModelData, load_body_model
from tests.smoke_run import finished_runs, link_run

# A shared machine pauses now and then, and a failure must be found again by running again.
settings.register_profile("dsnet", deadline=None, derandomize=True)
settings.load_profile("dsnet")


def hear_signals() -> None:
    """Answer Ctrl-C and SIGTERM in this process, and so in what it starts.

    Shells start deaf to Ctrl-C what they put into the background; an interrupted command is deaf
    to both until its process ends, which goes on where a test calls `dsnet.cli.main`.
    """
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)


hear_signals()


@pytest.fixture(autouse=True)
def _signals_are_heard() -> Iterator[None]:  # pyright: ignore[reportUnusedFunction]
    yield
    hear_signals()


@pytest.fixture(scope="module", autouse=True)
def _plugins_are_of_one_module() -> Iterator[None]:  # pyright: ignore[reportUnusedFunction]
    """Studies name their plugin for their whole process, which is ours."""
    before = os.environ.pop("DSNET_PLUGINS", None)
    yield
    os.environ.pop("DSNET_PLUGINS", None)
    if before is not None:
        os.environ["DSNET_PLUGINS"] = before


@pytest.fixture(scope="session")
def body() -> BodyModelData:
    """The embedded woman."""
    return load_body_model("embedded:female")


@pytest.fixture(scope="session")
def smoke_runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder that holds the finished run `smoke`; what is added to it only this process sees."""
    base = tmp_path_factory.getbasetemp()
    common = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base
    return link_run(finished_runs(common), tmp_path_factory.mktemp("runs"))


@pytest.fixture
def refusal(capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """What the command `dsnet` says of arguments that it refuses: one line, and status 2."""
    from dsnet.cli import main

    def run(*arguments: str) -> str:
        capsys.readouterr()
        with pytest.raises(SystemExit) as stopped:
            main([*arguments])
        said = capsys.readouterr().err
        assert (stopped.value.code, said.count("\n")) == (2, 1), said
        return said

    return run


@pytest.fixture(scope="session", autouse=True)
def _nothing_of_the_user(tmp_path_factory: pytest.TempPathFactory) -> None:  # pyright: ignore[reportUnusedFunction]
    """Neither a cache of bodies nor a body that is meant for always."""
    os.environ["XDG_CACHE_HOME"] = str(tmp_path_factory.mktemp("cache"))
    os.environ.pop("DSNET_BODY", None)


SHARES_NOTHING = ("tests/tf_dsnet", "tests/end_to_end")
"""Folders whose files may go to different processes."""


class FolderScheduling(LoadScopeScheduling):
    """Gives each folder to one process: its tests share what is slow to make, such as a run."""

    def _split_scope(self, nodeid: str) -> str:
        file = nodeid.partition("::")[0]
        folder = file.rpartition("/")[0]
        return file if folder.startswith(SHARES_NOTHING) else folder


def pytest_xdist_make_scheduler(config: pytest.Config, log: Producer) -> FolderScheduling:
    """Take that scheduler, whatever `--dist` says."""
    return FolderScheduling(config, log)
