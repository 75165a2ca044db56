from __future__ import annotations

import pytest
import torch

from tests.one_thread import one_thread as one_thread


@pytest.fixture(params=["cpu", pytest.param("cuda", marks=pytest.mark.gpu)])
def where(request) -> torch.device:
    """Where a network is trained: every test that asks is run on a processor and on a GPU."""
    if request.param == "cuda" and not torch.cuda.is_available():
        pytest.skip("PyTorch finds no GPU")
    return torch.device(request.param)
