"""The one place that says what PyTorch needs so that two runs give the same bits."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import torch

_SETTINGS: Any = torch.utils.deterministic
"""Its attributes are properties, of which the module's own annotations know nothing."""


@contextmanager
def reproducible() -> Iterator[None]:
    """Compute in an order that does not depend on timing.

    A processor needs nothing but the same number of threads, for sums are split by it; whatever is
    drawn at random has a generator with the run's seed. On a GPU cuBLAS has to keep one workspace,
    and operations that add in no fixed order are replaced, or refused with an error.
    """
    os.environ.setdefault("CUBLAS_WORKSPACE_CONFIG", ":4096:8")
    before = torch.are_deterministic_algorithms_enabled(), _SETTINGS.fill_uninitialized_memory
    torch.use_deterministic_algorithms(True)
    # Nothing here reads memory that it has not written, and filling it costs a pass over it.
    _SETTINGS.fill_uninitialized_memory = False
    try:
        yield
    finally:
        torch.use_deterministic_algorithms(before[0])
        _SETTINGS.fill_uninitialized_memory = before[1]
