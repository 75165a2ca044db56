"""Where work that can leave this machine is done: here, or on the nodes of a Ray cluster."""

from __future__ import annotations

import logging
import os
import signal
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Literal, get_args

from bridge.errors import DsnetError
from bridge.installation import require_package

Engine = Literal["local", "ray"]

_chosen: Engine = "local"
# Of the driver, and what a worker must know besides its work.
_PASSED_ON = ("DSNET_RUNS", "DSNET_PLUGINS", "PYTHONPATH")


def chosen_engine() -> Engine:
    """The one that `use_engine` chose."""
    return _chosen


@contextmanager
def use_engine(name: str, address: str | None = None) -> Iterator[None]:
    """Choose the engine for the time of a `with` block.

    Parameters
    ----------
    address : of a running Ray cluster, as `ray.init` takes it; None starts one on this machine.

    Raises
    ------
    DsnetError
        If there is no such engine or cluster, or Ray is not installed.
    """
    global _chosen
    if name not in get_args(Engine):
        raise DsnetError(f"--engine {name}", "local or ray", "Pass --engine ray.")
    if name == "local":
        if address is not None:
            raise DsnetError(
                f"--address {address} without a cluster", "--engine ray", "Pass --engine ray."
            )
        yield
        return
    before, _chosen = _chosen, "ray"
    try:
        with _connected(address):
            yield
    finally:
        _chosen = before


@contextmanager
def _connected(address: str | None) -> Iterator[None]:
    require_package("ray", "ray", "--engine ray")
    # Read when Ray is imported: nothing is reported to anybody, and work without a GPU sees what
    # the machine has.
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
    import ray

    # What workers make lies in files, so Ray's store of objects holds little.
    own = {} if address else {"include_dashboard": False, "object_store_memory": 256 << 20}
    variables = {name: os.environ[name] for name in _PASSED_ON if name in os.environ}
    at_end = signal.getsignal(signal.SIGTERM)
    try:
        _knock(address)
        ray.init(
            address=address or "local",
            runtime_env={"env_vars": variables},
            log_to_driver=False,
            logging_level=logging.CRITICAL,
            **own,
        )
    except (OSError, ValueError) as error:
        if address is None:
            raise
        raise DsnetError(
            f"--address {address}, where no Ray cluster answers",
            "HOST:PORT of its head node, or auto on one of its nodes",
            "Start one with `ray start --head`.",
        ) from error
    signal.signal(signal.SIGTERM, at_end)  # Ray's own exits with another status
    try:
        yield
    finally:
        ray.shutdown()


def _knock(address: str | None) -> None:
    """Ray itself tries for minutes."""
    host, colon, port = (address or "").rpartition(":")
    if colon:
        socket.create_connection((host, int(port)), timeout=10).close()
