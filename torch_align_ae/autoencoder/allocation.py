"""Ask the C library to keep freed memory instead of returning it to the kernel.

A training step frees and allocates half a gigabyte of activations and
gradients. glibc maps blocks of this size anew each time: 40,000 to 60,000 page
faults a step, which are dear in a virtual machine. Kept, there are none.
"""

from __future__ import annotations

import ctypes
import platform

_M_TRIM_THRESHOLD, _M_TOP_PAD, _M_MMAP_MAX = -1, -2, -4
_KEPT_BYTES = 1 << 30
_STEP_BYTES = 1 << 26


def keep_freed_memory() -> None:
    """Apply to the whole process; elsewhere than on glibc this does nothing."""
    if platform.libc_ver()[0] != "glibc":
        return
    libc = ctypes.CDLL(None)
    libc.mallopt(_M_MMAP_MAX, 0)
    libc.mallopt(_M_TRIM_THRESHOLD, _KEPT_BYTES)
    libc.mallopt(_M_TOP_PAD, _STEP_BYTES)
