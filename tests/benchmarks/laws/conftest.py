"""The corpus knows the laws and forms, as in the studies."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from benchmarks import plugin
from tests.dsnet.synthetic.conftest import corpus, finished, truth

__all__ = ["corpus", "finished", "truth"]


@pytest.fixture(scope="module", autouse=True)
def _laws() -> Iterator[None]:  # pyright: ignore[reportUnusedFunction]
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DSNET_PLUGINS", plugin.__name__)
        yield
