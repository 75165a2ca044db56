"""What a page is given: bodies, motions, the graph that moves the skin, and tracks of others.

Everything has a name and is made when it is asked for: a server makes it on demand, a file that
needs no network has all of it. A body model that may not be shipped is never in it: then all that
is seen of the body, SMPL alone included, are tracks of places, posed.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bridge.body.parts import PARTS, part_weights
from bridge.body.posing import Smpl
from bridge.errors import DsnetError
from bridge.motion import Motion, unpack_theta
from bridge.motion.cuts import pieces_between_cuts
from bridge.motion.motion_checks import motion_warnings
from bridge.tissue.trained_plus import TrainedPlus
from dsnet.onnx.body_graph import bone_weights
from dsnet.onnx.plus_graph import plus_graph, plus_layout
from dsnet.prediction.controls import gains_of_parts, root_joint_m
from dsnet.prediction.loops import Lap, close_lap
from dsnet.prediction.models import PlusModel
from dsnet.prediction.moving_body import MovingBody, pose_on
from dsnet.prediction.shape_space import PELVIS_M
from dsnet.prediction.shapes import SHAPES, find_shape
from dsnet.view.clip_list import TRUTH, Repertoire, ViewedMotion

BUNDLE = Path(str(resources.files("dsnet.view"))) / "bundle"
"""What `web/` is built to: the page, and what runs graphs."""
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


class Scene:
    """What one page can show.

    `controls` are those of a moving body, where the page's knobs stand at first; `lap` is the loop
    that all motions are, if what is baked is to repeat.
    """

    def __init__(
        self,
        repertoire: Repertoire,
        controls: Mapping[str, Any] | None = None,
        lap: Lap | None = None,
    ) -> None:
        self._repertoire, self._controls, self._lap = repertoire, controls or {}, lap
        self._body, self._takes = repertoire.best.body, list(repertoire.takes.items())
        self._live, self._plus, self.baked = self._live_predictor()
        """Why nothing lives in the page; empty where something does."""
        self.assets: dict[str, Callable[[], bytes]] = {"scene": self._scene}
        """Bytes by name; `runtime`, which runs graphs, is packed by gzip."""
        if plus := self._plus:
            self.assets |= {
                "runtime": (BUNDLE / "runtime.wasm.gz").read_bytes,
                "model": lambda: plus_graph(plus, self._body, in_parts=True).SerializeToString(),
                "shapes": self._shapes,
            }
        for number, (_, take) in enumerate(self._takes):
            self.assets[f"motion{number}"] = partial(self._motion, number)
            if self._plus:
                self.assets[f"loop{number}"] = partial(self._loop, number)
            for name in self._tracks(take):
                self.assets[f"track{number}_{name}"] = partial(self._track, number, name)

    def _live_predictor(self) -> tuple[str, TrainedPlus | None, str]:
        """The one whose graph runs in the page; else why there is none."""
        repertoire = self._repertoire
        if self._body.source != "synthetic":
            why = "This body model needs a licence and is not in the page: its surface is baked in."
            return "", None, why
        for name in repertoire.predictors:
            if isinstance(model := repertoire.open(name).model, PlusModel):
                return name, model.trained, ""
        why = "These predictors are too large for a page: what they gave is baked into it."
        return "", None, why

    def _scene(self) -> bytes:
        repertoire, body, asked = self._repertoire, self._body, self._controls
        facts: dict[str, Any] = {
            "owner": repertoire.best.owner,
            "origin": repertoire.best.shows,
            "gender": body.gender,
            "baked": self.baked,
            "faces": _text(body.faces, "<u2" if body.vertex_count < 1 << 16 else "<u4"),
            "vertices": body.vertex_count,
            "parts": PARTS,
            "part_weights": _text(part_weights(body).T, "<f4"),
            "most_frames": MOST_FRAMES,
            "start": {
                "gain": asked.get("gain", 1.0),
                "parts": gains_of_parts(asked.get("part_gain", ())).tolist(),
                "loop": asked.get("loop", False),
            },
            "labels": {SMPL_ALONE: "SMPL alone", **repertoire.predictors, TRUTH: TRUTH},
            "motions": [{"name": name, "tracks": self._tracks(take)} for name, take in self._takes],
        }
        return json.dumps(facts | self._facts_of_skin()).encode()

    def _facts_of_skin(self) -> dict[str, Any]:
        """What the page must know to run the graph and to pose what it gives; where there is none,
        one bone carries everything."""
        body, plus = self._body, self._plus
        weights = bone_weights(body) if plus else np.ones((body.vertex_count, 1))
        each = int((weights > 0).sum(axis=1).max())
        bones = np.argsort(-weights, axis=1, kind="stable")[:, :each]
        skin = {
            "bone_of": _text(bones, "u1"),
            "bone_weight": _text(np.take_along_axis(weights, bones, 1), "<f4"),
        }
        if plus is None:
            return skin
        layout = plus_layout(plus)
        moves = layout.columns("moves")
        return skin | {
            "graph": {
                "predictor": self._live,
                "latency": plus.look_ahead,
                "state_size": layout.size,
                "moves": [moves.start, moves.stop],
            },
            "root_joint": body.joints[0].tolist(),
            "root_joint_shapes": body.joint_shapes[0].tolist(),
            "pelvis_m": PELVIS_M,
        }

    def _shapes(self) -> bytes:
        """Betas by name: of the people, and of shapes in words that this body can have."""
        found = {name: betas.tolist() for name, betas in self._repertoire.people.items()}
        for name in SHAPES:
            try:
                found[name] = find_shape(self._body, [name]).tolist()
            except DsnetError:  # out of this body's reach
                continue
        return json.dumps(found).encode()

    def _tracks(self, take: ViewedMotion) -> list[str]:
        """Who is shown by a track: all but the live predictor, and the truth where it is known."""
        names = [name for name in self._repertoire.predictors if name != self._live]
        known = [TRUTH] if self._repertoire.truth_of(take) else []
        return [SMPL_ALONE] * (not self._plus) + names + known

    def _shown(self, take: ViewedMotion) -> Motion:
        """As much of a motion as the page shows."""
        most = TRACK_FRAMES if self._tracks(take) else MOST_FRAMES
        truth = self._repertoire.truth_of(take)
        return take.read().frames(slice(min(most, truth.length) if truth else most))

    def _motion(self, number: int) -> bytes:
        _, take = self._takes[number]
        whole, motion = len(take.read().theta), self._shown(take)
        pieces = pieces_between_cuts(motion.theta)
        says = motion_warnings(motion, pieces)
        if (left_out := whole - len(motion.theta)) and not self._repertoire.truth_of(take):
            says.append(f"{left_out} of its {whole} frames are left out: pages show less")
        starts = [piece.start for piece in pieces]
        return self._played(number, motion, motion.theta, starts=starts, says=says)

    def _played(self, number: int, motion: Motion, theta: NDArray, **more: Any) -> bytes:
        first = motion.frames(slice(1))
        by_joint = [
            first.about_root_joint(axis).trans_m[0] - first.trans_m[0] for axis in np.eye(3)
        ]
        facts = {
            "name": self._takes[number][0],
            "theta": _text(theta, "<f8"),
            "betas": motion.betas.tolist(),
            "fps": motion.fps,
            "first": 0,
            "count": len(theta),
            # How the root's place follows the root joint, which goes with the shape.
            "by_joint": np.transpose(by_joint).tolist(),
        }
        return json.dumps(facts | more).encode()

    def _loop(self, number: int) -> bytes:
        """The motion as one that repeats: rounds that lead to the one that is shown, and on."""
        motion = self._shown(self._takes[number][1])
        try:
            if len(pieces_between_cuts(motion.theta)) > 1:
                raise DsnetError("a motion with cuts", "one without", "Choose another.")
            lap = close_lap(motion.theta, root_joint_m(self._body, motion.betas))
        except DsnetError as error:
            return json.dumps({"failed": str(error)}).encode()
        count = len(lap.theta)
        before = max(2, int(np.ceil(_LOOPED_S * motion.fps / count)))
        theta, place = rounds_around(lap, before, _AHEAD), {"first": before * count, "count": count}
        return self._played(number, motion, theta, starts=[0], says=[], **place)

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
        motion = self._shown(take)
        pose, trans_m = pose_on(motion, self._body), motion.trans_m
        alone = Smpl(self._body).person(motion.betas)
        if name == SMPL_ALONE:
            yield alone.pose(pose, 0 * trans_m)
        elif name != TRUTH and not self.baked:
            moving = MovingBody(self._repertoire.open(name), motion)
            yield from (piece.offsets_m for piece in moving)
        else:
            for frames, vertices_m in self._posed(name, take, motion):
                places_m, turns = alone.skin(pose[frames], trans_m[frames])
                apart_m = vertices_m - places_m
                yield apart_m if self.baked else np.linalg.solve(turns, apart_m[..., None])[..., 0]

    def _posed(
        self, name: str, take: ViewedMotion, motion: Motion
    ) -> Iterator[tuple[slice, NDArray]]:
        """Vertices in the world, some frames at a time."""
        truth, sequence = self._repertoire.truth, take.sequence
        if name != TRUTH or truth is None:
            moving = MovingBody(self._repertoire.open(name), motion, loop=self._lap)
            yield from ((piece.frames, piece.vertices_m) for piece in moving)
            return
        person = Smpl(self._body).person(truth.betas(sequence))
        for start in range(0, len(motion.theta), _AT_ONCE):
            frames = slice(start, min(start + _AT_ONCE, len(motion.theta)))
            pose, trans_m = unpack_theta(truth.frames("theta", sequence, frames))
            yield frames, person.pose(pose, trans_m, truth.offsets_m(sequence, frames))


def rounds_around(lap: Lap, before: int, ahead: int) -> NDArray[np.floating]:
    """(T, 69) some rounds before a lap, each ending where the next begins, the lap itself, and some
    frames that follow it."""
    unturned = Rotation.from_rotvec([0.0, -lap.turn_rad, 0.0])
    back = replace(lap, turn_rad=-lap.turn_rad, shift_m=-unturned.apply(lap.shift_m))
    rounds = back.repeated(before + 1).reshape(before + 1, *lap.theta.shape)[::-1]
    return np.concatenate([*rounds, lap.repeated(2)[len(lap.theta) :][:ahead]])


def _text(array: NDArray, dtype: str) -> str:
    return base64.b64encode(np.ascontiguousarray(array, dtype).tobytes()).decode("ascii")
