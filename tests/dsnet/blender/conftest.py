"""One second of a walk, of a heavy woman."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bridge.motion import Motion, load_motion


@pytest.fixture(scope="session")
def walk() -> Motion:
    walk = load_motion("sample:walking").frames(slice(60, 130))
    return replace(walk, betas=np.array([0.0, 1.5, 1.0, *[0.0] * 7]))
