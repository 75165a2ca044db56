"""A module of somebody's that adds one of each kind to `dsnet`, as short as they can be."""

from __future__ import annotations

from pathlib import Path

import pytest

SOURCE = '''
def predictors():
    from dataclasses import dataclass

    from tf_dsnet.predictors import DsnetPredictor

    @dataclass(frozen=True)
    class Mine(DsnetPredictor):
        name: str = "mine"
        label: str = "DSNet of mine"

    return {"mine": Mine()}


def tissues():
    import numpy as np

    class Jelly:
        """Hangs behind by as much as the body moves in a frame."""

        def __init__(self, body, betas, *, gravity):
            self.count = body.vertex_count

        def offsets(self, theta, fps):
            lag_m = -np.gradient(theta[:, 66:], axis=0).astype(np.float32)
            return np.repeat(lag_m[:, None], self.count, axis=1)

    return {"jelly": Jelly}


def mesh_forms():
    import numpy as np

    class Thick:
        """A millimetre more, on the file's meshes only."""

        def __init__(self, data, seed):
            self.count = data.vertex_count

        def static(self, subject, theta):
            return np.zeros((len(theta), self.count, 3), np.float32)

        def registered(self, sequence, meshes, fps):
            return meshes + np.float32(1e-3)

    return {"thick": Thick}
'''


def use_plugin(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, source: str = SOURCE) -> str:
    """Write the module where it can be imported, and name it; returns its name."""
    name = f"mine_{tmp_path.name}"
    (tmp_path / f"{name}.py").write_text(source)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("DSNET_PLUGINS", name)
    return name
