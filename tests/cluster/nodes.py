"""A Ray cluster of two nodes on this machine, of which one can be killed; and `dsnet` beside it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from tests.smoke_run import ONE_CORE

_NODES = """
import sys
from ray.cluster_utils import Cluster
cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
other = cluster.add_node(num_cpus=1)
print(cluster.address, flush=True)
if sys.stdin.readline().strip() == "kill":
    cluster.remove_node(other, allow_graceful=False)
    print("killed", flush=True)
    sys.stdin.readline()
cluster.shutdown()
"""


class TwoNodes:
    """Two raylets of a core each, in a process of their own."""

    def __init__(self, folder: Path) -> None:
        environment = {
            "RAY_USAGE_STATS_ENABLED": "0",
            "RAY_TMPDIR": str(folder),  # of the sockets
            # Ray refuses work where 95 % of a disk are used, however much is left of it.
            "RAY_local_fs_capacity_threshold": "0.999",
        }
        self._process = subprocess.Popen(
            [sys.executable, "-W", "ignore", "-c", _NODES],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            env=os.environ | environment,
        )
        self.address = self._answer()

    def kill_one(self) -> None:
        """Kill the second raylet, and with it all that runs there."""
        self._say("kill")
        assert self._answer() == "killed"

    def close(self) -> None:
        """End what is left."""
        self._say("end")
        self._process.communicate(timeout=60)

    def _say(self, word: str) -> None:
        assert self._process.stdin
        self._process.stdin.write(f"{word}\n")
        self._process.stdin.flush()

    def _answer(self) -> str:
        assert self._process.stdout
        return self._process.stdout.readline().strip()


def start_dsnet(runs: Path, stage: str, *options: str) -> subprocess.Popen[str]:
    """`dsnet stage options`, with its runs in a folder."""
    command = [sys.executable, "-c", "from dsnet.cli import main; main()", stage, *options]
    return subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env=os.environ | {"DSNET_RUNS": str(runs)} | ONE_CORE,
    )


def ended_well(process: subprocess.Popen[str]) -> None:
    """Wait for a command, which must not fail."""
    said, _ = process.communicate(timeout=600)
    assert process.returncode == 0, said
