"""When, where and how something was made: all that differs between two identical runs."""

from __future__ import annotations

import os
import platform
import sys
import time
from pathlib import Path
from typing import Any

from bridge.installation import version_of

try:
    import resource
except ModuleNotFoundError:  # Windows
    resource = None

_RECORDED_PACKAGES = ("numpy", "scipy", "torch", "tensorflow", "keras")


def provenance(wall_time_s: float) -> dict[str, Any]:
    """When, where, by which command and with which versions something was made."""
    versions = {name: found for name in _RECORDED_PACKAGES if (found := version_of(name))}
    return {
        "command": [Path(sys.argv[0]).name, *sys.argv[1:]],
        "finished_utc": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        "wall_time_s": round(wall_time_s, 3),
        "peak_memory_mb": _peak_memory_mb(),
        "machine": f"{machine()}, {os.cpu_count()} cores",
        "versions": {"python": platform.python_version(), **versions},
    }


def machine() -> str:
    """System and processor, such as `Linux AMD EPYC`: times say nothing without."""
    cpuinfo = Path("/proc/cpuinfo")  # only Linux has it
    lines = cpuinfo.read_text(encoding="utf-8").splitlines() if cpuinfo.is_file() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    processor = names[0] if names else platform.processor() or platform.machine()
    return f"{platform.system()} {processor}"


def _peak_memory_mb() -> int:
    """Largest resident memory so far of this process, or of one that it has started.

    Windows keeps the peak of this process alone.
    """
    if resource is None:
        import psutil

        memory = psutil.Process().memory_info()
        return round(getattr(memory, "peak_wset", memory.rss) / 2**20)
    whose = (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    largest = max(resource.getrusage(one).ru_maxrss for one in whose)
    return round(largest / (2**20 if sys.platform == "darwin" else 2**10))
