"""What a folder's prediction asks of every motion, and what is known of each."""

from __future__ import annotations

import json
from contextlib import redirect_stderr
from dataclasses import dataclass
from functools import lru_cache, partial
from io import StringIO
from pathlib import Path
from typing import Any

from bridge.body.embedded import EMBEDDED
from bridge.motion import Motion
from dsnet.prediction.controls import Controls, controlled_body
from dsnet.prediction.load_model import Source, TrainedModel, load_model, name_of
from dsnet.prediction.moving_body import MovingBody
from dsnet.prediction.prediction_files import OFFSETS, node_count
from dsnet.prediction.runtimes import Runtime
from dsnet.prediction.shape_space import UseOfBetas

_BYTES = {"offsets": 12, "offsets16": 6, "vertices": 12}
"""Of a vertex in a frame."""
_NODE_BYTES, _THETA_BYTES = 6, 276
"""Of a node in a frame, and of a frame's pose."""
_load = lru_cache(maxsize=8)(load_model)


@dataclass(frozen=True)
class FolderJob:
    """What is to be made of every motion of the folder; workers have a copy."""

    source: Source
    predictor: str | None
    controls: Controls
    write: tuple[str, ...]
    shared: Path
    """Folder of what all of them need, once."""
    runtime: Runtime = "onnx"

    def load(self, path: Path) -> tuple[TrainedModel, Motion]:
        """The predictor of a file's motion, and the motion as the file has it."""
        load = partial(_load, runtime=self.runtime)
        return self.controls.load(self.source, self.predictor, path, load)

    def moving(self, path: Path) -> tuple[MovingBody, UseOfBetas, list[str]]:
        """The body that performs it, what becomes of the file's betas, and the warnings about it,
        which the terminal does not get."""
        with redirect_stderr(StringIO()) as stderr:
            trained, motion = self.load(path)
            moving = controlled_body(trained, motion, self.controls)
        lines = [line.removeprefix("dsnet: ") for line in stderr.getvalue().splitlines()]
        of_betas = self.controls.use_of_betas(motion, trained.body)
        return moving, of_betas, lines + moving.warnings()

    def bytes_a_frame(self, trained: TrainedModel) -> int:
        """Of what is written of a motion; `DsnetError` of nodes that the predictor has not."""
        of_vertex = sum(_BYTES.get(word, 0) for word in self.write)
        nodes = node_count(trained) if "nodes16" in self.write else 0
        theta = _THETA_BYTES if {*OFFSETS} & {*self.write} else 0
        return of_vertex * trained.body.vertex_count + _NODE_BYTES * nodes + theta

    @property
    def config(self) -> dict[str, Any]:
        """As in the manifest of a prediction."""
        given = {
            "run": name_of(self.source),
            "predictor": self.predictor,
            "write": self.write,
            "controls": self.controls.given(),
            "body": self._body(),
            "joints": dict(self.controls.how_read().joint_map),
        }
        if self.runtime != "onnx":  # without it as before there was a choice
            given["runtime"] = self.runtime
        return json.loads(json.dumps(given))

    def _body(self) -> list[tuple[str, int, int]] | str | None:
        """Names, sizes and times of the model files that were requested: they may be gigabytes."""
        path = self.controls.body
        if path is None or str(path) == EMBEDDED or not path.exists():
            return path and str(path)
        files = sorted(one for one in (path, *path.rglob("*")) if one.is_file())
        about = ((one.relative_to(path.parent).as_posix(), one.stat()) for one in files)
        return [(name, status.st_size, status.st_mtime_ns) for name, status in about]


@dataclass(frozen=True)
class MotionJob:
    """One file below the folder."""

    path: Path
    name: str
    """From the folder on."""
    out: Path
    frames: int = 0
    bytes: int = 0
    """Of what will be written."""
    refusal: str = ""
    warnings: int = 0
    """Lines of them in its manifest."""
    body: str = ""
    """Whose moves."""
    of_betas: UseOfBetas = "none"
