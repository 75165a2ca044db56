"""The commands know the systems, as those of the studies do."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from benchmarks import plugin


@pytest.fixture(scope="module", autouse=True)
def _systems() -> Iterator[None]:  # pyright: ignore[reportUnusedFunction]
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DSNET_PLUGINS", plugin.__name__)
        yield
