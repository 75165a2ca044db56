"""Processes that torchrun starts take a GPU each, or are refused."""

from __future__ import annotations

import pytest
import torch

from bridge import DsnetError
from torch_align_ae.workers import joined_by_torchrun


def test_more_processes_than_gpus_are_refused_before_any_waits(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 1)
    for name, value in (("WORLD_SIZE", "2"), ("LOCAL_WORLD_SIZE", "2"), ("LOCAL_RANK", "0")):
        monkeypatch.setenv(name, value)
    with (
        pytest.raises(DsnetError, match=r"2 processes on a machine of 1 GPU\(s\)"),
        joined_by_torchrun(),
    ):
        pass
