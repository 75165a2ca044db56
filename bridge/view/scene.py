"""What a page is given: bodies, motions, the graph that moves the skin, and tracks of others.

Everything has a name and is made when it is asked for: a server makes it on demand, a file that
needs no network has all of it. A body model that may not be shipped is never in it: then all that
is seen of the body, SMPL alone included, are tracks of places, posed.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np
import onnx
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bridge.body.embedded import EMBEDDED_PREFIX
from bridge.body.parts import PARTS, part_weights
from bridge.body.posing import Smpl
from bridge.body.shapes import SHAPES, find_shape
from bridge.errors import DsnetError
from bridge.motion import Motion, unpack_theta
from bridge.motion.cuts import pieces_between_cuts
from bridge.motion.loops import Lap, close_lap
from bridge.motion.motion_checks import motion_warnings
from bridge.runtime.body_graph import bone_weights
from bridge.runtime.controls import root_joint_m
from bridge.runtime.moving_body import MovingBody
from bridge.runtime.plus_graph import plus_graph
from bridge.runtime.stepping import PlusModel
from bridge.view.repertoire import TRUTH, Repertoire, ViewedMotion

MOST_FRAMES = 36_000
"""Of a motion in a page: ten minutes."""
TRACK_FRAMES = 1200
"""Of a motion that is shown with tracks, 41 kB a frame each: 20 s."""
STEP_M = 5e-5
"""Of the numbers of a track."""
SMPL_ALONE = "smpl"
_AT_ONCE = 64
_LOOPED_S = 6.0
"""Before the round of a loop that is shown: by then the tissue has forgotten how it began."""
_AHEAD = 8
"""Frames behind the last round, which the model may look at."""


@dataclass(frozen=True)
class Start:
    """Where the page's controls stand at first."""

    gain: float = 1.0
    parts: tuple[float, ...] = (1.0,) * len(PARTS)
    loop: bool = False


class Scene:
    """What one page can show.

    `lap` is the loop that all motions are, if what is baked is to repeat.
    """

    def __init__(
        self, repertoire: Repertoire, start: Start | None = None, lap: Lap | None = None
    ) -> None:
        self._repertoire, self._start, self._lap = repertoire, start or Start(), lap
        self._takes = list(repertoire.takes.items())
        self._live = self._live_predictor()
        self.baked = self._live is None
        self.assets: dict[str, Callable[[], bytes]] = {"scene": self._scene}
        """Bytes by name."""
        if not self.baked:
            self.assets |= {"model": self._model_bytes, "shapes": self._shapes}
        for number, (_, take) in enumerate(self._takes):
            self.assets[f"motion{number}"] = partial(self._motion, number)
            if not self.baked:
                self.assets[f"loop{number}"] = partial(self._loop, number)
            for name in self._tracks(take):
                self.assets[f"track{number}_{name}"] = partial(self._track, number, name)

    def _live_predictor(self) -> str | None:
        """The one whose graph runs in the page; none where the body may not be in it."""
        repertoire = self._repertoire
        if repertoire.body_model.startswith(EMBEDDED_PREFIX):
            for name in repertoire.predictors:
                if isinstance(repertoire.open(name).model, PlusModel):
                    return name
        return None

    @cached_property
    def _graph(self) -> onnx.ModelProto:
        assert self._live is not None
        model = self._repertoire.open(self._live).model
        assert isinstance(model, PlusModel)
        return plus_graph(model.trained, self._repertoire.body, in_parts=True)

    def _model_bytes(self) -> bytes:
        return self._graph.SerializeToString()

    def _scene(self) -> bytes:
        repertoire, body = self._repertoire, self._repertoire.body
        root = np.asarray((body.J_regressor @ np.eye(body.vertex_count))[0]).ravel()
        facts: dict[str, Any] = {
            "owner": repertoire.owner,
            "origin": repertoire.origin,
            "gender": body.gender,
            "baked": self._why_baked(),
            "faces": _text(body.faces, "<u2" if body.vertex_count < 1 << 16 else "<u4"),
            "vertices": body.vertex_count,
            "parts": PARTS,
            "part_weights": _text(part_weights(body).T, "<f4"),
            "most_frames": MOST_FRAMES,
            "start": vars(self._start),
            "predictors": [
                {"name": name, "label": label} for name, label in repertoire.predictors.items()
            ],
            "motions": [{"name": name, "tracks": self._tracks(take)} for name, take in self._takes],
        }
        if not self.baked:
            about = {entry.key: entry.value for entry in self._graph.metadata_props}
            facts["graph"] = {
                "state": {
                    name: (at, shape) for name, at, shape in json.loads(about["state_layout"])
                },
                "predictor": self._live,
                "latency": int(about["latency_frames"]),
            }
            weights = bone_weights(body)
            each = int((weights > 0).sum(axis=1).max())
            bones = np.argsort(-weights, axis=1, kind="stable")[:, :each]
            facts |= {
                "bone_of": _text(bones, "u1"),
                "bone_weight": _text(np.take_along_axis(weights, bones, 1), "<f4"),
                "root_joint": (root @ body.v_template).tolist(),
                "root_joint_shapes": np.einsum("v,vxb->xb", root, body.shapedirs).tolist(),
            }
        return json.dumps(facts).encode()

    def _why_baked(self) -> str:
        if not self.baked:
            return ""
        if self._repertoire.body_model.startswith(EMBEDDED_PREFIX):
            return "These predictors are too large for a page: what they gave is baked into it."
        return "This body model needs a licence and is not in the page: its surface is baked in."

    def _shapes(self) -> bytes:
        """Betas by name: of the people, and of shapes in words that this body can have."""
        found = {name: betas.tolist() for name, betas in self._repertoire.people.items()}
        for name in SHAPES:
            try:
                found[name] = find_shape(self._repertoire.body, [name]).tolist()
            except DsnetError:  # out of this body's reach
                continue
        return json.dumps(found).encode()

    def _tracks(self, take: ViewedMotion) -> list[str]:
        """Who is shown by a track: all but the live predictor, and the truth where it is known."""
        names = [name for name in self._repertoire.predictors if name != self._live]
        known = [TRUTH] if take.truth is not None else []
        return [SMPL_ALONE] * self.baked + names + known

    def _shown(self, number: int) -> Motion:
        """As much of a motion as the page shows."""
        _, take = self._takes[number]
        motion = take.read()
        most = TRACK_FRAMES if self._tracks(take) else MOST_FRAMES
        return motion.frames(slice(min(most, take.frames or most)))

    def _motion(self, number: int) -> bytes:
        name, take = self._takes[number]
        whole, motion = len(take.read().theta), self._shown(number)
        starts = [piece.start for piece in pieces_between_cuts(motion.theta)]
        says = motion_warnings(motion, pieces_between_cuts(motion.theta))
        if (left_out := whole - len(motion.theta)) and take.truth is None:
            says.append(f"{left_out} of its {whole} frames are left out: pages show less")
        facts = self._facts(name, motion, motion.theta, starts, take.of_file)
        return json.dumps(facts | {"says": says}).encode()

    def _facts(
        self, name: str, motion: Motion, theta: NDArray, starts: list[int], of_file: bool
    ) -> dict[str, Any]:
        return {
            "name": name,
            "theta": _text(theta, "<f8"),
            "betas": motion.betas.tolist(),
            "gender": motion.gender,
            "fps": motion.fps,
            "starts": starts,
            "first": 0,
            "count": len(theta),
            "of_file": of_file,
        }

    def _loop(self, number: int) -> bytes:
        """The motion as one that repeats: some rounds, of which the last is shown."""
        name, take = self._takes[number]
        motion = self._shown(number)
        try:
            if len(pieces_between_cuts(motion.theta)) > 1:
                raise DsnetError("a motion with cuts", "one without", "Choose another.")
            lap = close_lap(motion.theta, root_joint_m(self._repertoire.body, motion.betas))
        except DsnetError as error:
            return json.dumps({"failed": str(error)}).encode()
        frames = len(lap.theta)
        before = max(2, int(np.ceil(_LOOPED_S * motion.fps / frames)))
        theta = lap.repeated(before + 2)[: (before + 1) * frames + _AHEAD]
        facts = self._facts(name, motion, theta, [0], take.of_file)
        shown = {"first": before * frames, "count": frames, "back": _way_back(lap, before)}
        return json.dumps(facts | shown | {"says": []}).encode()

    def _track(self, number: int, name: str) -> bytes:
        """(T, 3, V) as whole steps, differences in time, behind the size of a step in metres."""
        frames = np.concatenate([part.transpose(0, 2, 1) for part in self._places(number, name)])
        step_m = max(STEP_M, float(np.abs(frames).max()) / 32_000)
        steps = np.rint(frames / step_m).astype(np.int16)
        differences = np.diff(steps, axis=0, prepend=np.zeros_like(steps[:1]))
        return np.float32(step_m).tobytes() + differences.astype("<i2").tobytes()

    def _places(self, number: int, name: str) -> Iterator[NDArray]:
        """Pieces (T', V, 3), metres: offsets in the rest pose of the motion, so that a truth of
        another pose stands where it stood; in a baked page posed, and places about the root."""
        _, take = self._takes[number]
        motion, repertoire = self._shown(number), self._repertoire
        pose, trans_m = unpack_theta(motion.theta)
        alone = Smpl(repertoire.body).person(motion.betas)
        if name not in (SMPL_ALONE, TRUTH) and not self.baked:
            yield from (piece.offsets_m for piece in MovingBody(repertoire.open(name), motion))
            return
        for frames, vertices_m in self._posed(name, take, motion):
            if name == SMPL_ALONE:
                yield vertices_m - trans_m[frames, None]
                continue
            places_m, turns = alone.skin(pose[frames], trans_m[frames])
            apart_m = vertices_m - places_m
            if self.baked:
                yield apart_m
            else:
                yield np.linalg.solve(turns, apart_m[..., None])[..., 0]

    def _posed(
        self, name: str, take: ViewedMotion, motion: Motion
    ) -> Iterator[tuple[slice, NDArray]]:
        """Vertices in the world, some frames at a time."""
        repertoire, offsets_m, theta, betas = self._repertoire, None, motion.theta, motion.betas
        if name == TRUTH and take.truth is not None and repertoire.read_truth is not None:
            truth = repertoire.read_truth(take.truth)
            offsets_m, theta, betas = truth.offsets_m, truth.theta, truth.betas
        elif name != SMPL_ALONE:
            moving = MovingBody(repertoire.open(name), motion, loop=self._lap)
            yield from ((piece.frames, piece.vertices_m) for piece in moving)
            return
        pose, trans_m = unpack_theta(theta)
        person = Smpl(repertoire.body).person(betas)
        for start in range(0, len(motion.theta), _AT_ONCE):
            frames = slice(start, min(start + _AT_ONCE, len(motion.theta)))
            moved_m = None if offsets_m is None else offsets_m[frames]
            yield frames, person.pose(pose[frames], trans_m[frames], moved_m)


def _way_back(lap: Lap, rounds: int) -> list[float]:
    """From where the round after so many stands to the first: a matrix by rows, then a shift."""
    unturned = Rotation.from_rotvec([0.0, -lap.turn_rad, 0.0]).as_matrix()
    back, shift_m = np.eye(3), np.zeros(3)
    for _ in range(rounds):  # a round is turned, then shifted
        back = unturned @ back
        shift_m = unturned @ (shift_m - lap.shift_m)
    return [*back.ravel().tolist(), *shift_m.tolist()]


def _text(array: NDArray, dtype: str) -> str:
    return base64.b64encode(np.ascontiguousarray(array, dtype).tobytes()).decode("ascii")
