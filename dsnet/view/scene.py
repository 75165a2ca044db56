"""The assets of a page: the body, motions, the ONNX graph that moves the skin, and tracks.

An asset has a name and a function that makes it: a server calls it on request, a page that is
written to a file holds all assets. A track is what the page cannot compute itself, frame by frame:
skin offsets of another predictor or of the truth. A licensed body model is never in a page; then
everything, SMPL alone included, is a track of posed vertices.
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
from bridge.body.skin import skin_png, split_at_seams
from bridge.errors import DsnetError
from bridge.motion import Motion, unpack_theta
from bridge.motion.motion_checks import motion_warnings
from bridge.tissue.trained_plus import TrainedPlus
from dsnet.onnx.body_graph import bone_weights
from dsnet.onnx.plus_graph import plus_graph, plus_layout
from dsnet.prediction.controls import root_joint_m
from dsnet.prediction.gains import LARGEST_STRAIN, edges_of, gains_of_parts
from dsnet.prediction.loops import Loop, close_loop
from dsnet.prediction.models import PlusModel
from dsnet.prediction.moving_body import MovingBody, pose_on
from dsnet.prediction.shape_space import PELVIS_M
from dsnet.prediction.shapes import SHAPES, find_shape
from dsnet.view.clip_list import TRUTH, Clip, ClipList
from dsnet.view.skeleton_rules import skeleton_rules

BUNDLE = Path(str(resources.files("dsnet.view"))) / "bundle"
"""Folder that `web/` is built into: the page, and the WebAssembly of ONNX Runtime."""
MOST_FRAMES = 36_000
"""Longest motion in a page: ten minutes."""
TRACK_FRAMES = 1200
"""Longest motion that is shown with tracks, of 41 kB a frame each: 20 s."""
STEP_M = 5e-5
"""Resolution of the numbers of a track."""
SMPL_ALONE = "smpl"
_FRAMES_AT_ONCE = 64
_WARM_UP_S = 6.0
"""Simulated before the cycle of a loop that is shown, so that the tissue moves periodically."""
_FRAMES_AHEAD = 8
"""Frames after that cycle, for the model's look-ahead."""


class Scene:
    """What one page can show.

    `controls` are those of a moving body, the first values of the page's knobs; `loop` is the cycle
    that is baked into tracks instead of the motion, if there is one; `plain` leaves out the picture
    of skin.
    """

    def __init__(
        self,
        clip_list: ClipList,
        controls: Mapping[str, Any] | None = None,
        loop: Loop | None = None,
        plain: bool = False,
    ) -> None:
        self._clip_list, self._controls, self._loop = clip_list, controls or {}, loop
        self.body, self._clips = clip_list.best.body, list(clip_list.clips.items())
        self._live, self._plus, self.baked = self._live_predictor()
        """Why no model runs in the page; empty if one does."""
        self._skin_png = None if plain else skin_png(self.body)
        self.assets: dict[str, Callable[[], bytes]] = {}
        """Functions that make the assets, by name; `runtime` is compressed by gzip."""
        if png := self._skin_png:
            self.assets["skin"] = lambda: png
        if plus := self._plus:
            self.assets |= {
                "runtime": (BUNDLE / "runtime.wasm.gz").read_bytes,
                "model": lambda: plus_graph(plus, self.body, in_parts=True).SerializeToString(),
                "shapes": self._shapes,
                "rules": skeleton_rules,
            }
        for number in range(len(self._clips)):
            self._offer(number)

    @property
    def body_model(self) -> tuple[str, str, tuple[int, ...]]:
        """Whose body it shows: model, gender and size of its space of shapes."""
        return self._clip_list.best.body_model, self.body.gender, self.body.shapedirs.shape

    def clip(self, number: int) -> Clip:
        """One of its motions."""
        return self._clips[number][1]

    def put(self, title: str, clip: Clip, number: int | None = None) -> int:
        """Add a motion of the same body, or set it in place of another; gives its number."""
        if number is None:
            number = len(self._clips)
            self._clips.append((title, clip))
        self._clips[number] = title, clip
        self._offer(number)
        return number

    def entry(self, number: int) -> dict[str, Any]:
        """Title of a motion, the names of its tracks, and how its file is read."""
        title, clip = self._clips[number]
        return {"name": title, "tracks": self._tracks(clip), "reading": clip.reading}

    def _offer(self, number: int) -> None:
        """The assets of a motion, made anew when they are asked for."""
        self.assets["scene"] = partial(self._scene)
        self.assets[f"motion{number}"] = partial(self._motion, number)
        if self._plus:
            self.assets[f"loop{number}"] = partial(self._loop_asset, number)
        for name in self._tracks(self.clip(number)):
            self.assets[f"track{number}_{name}"] = partial(self._track, number, name)

    def _live_predictor(self) -> tuple[str, TrainedPlus | None, str]:
        """Name and model of the predictor that runs in the page; or why none does."""
        clip_list = self._clip_list
        if self.body.source != "synthetic":
            why = "This body model needs a licence and is not in the page: its surface is baked in."
            return "", None, why
        for name in clip_list.predictors:
            if isinstance(model := clip_list.open(name).model, PlusModel):
                return name, model.trained, ""
        why = "These predictors are too large for a page: what they gave is baked into it."
        return "", None, why

    def _scene(self) -> bytes:
        clip_list, body, controls = self._clip_list, self.body, self._controls
        _, lengths_m = edges_of(body)
        facts: dict[str, Any] = {
            "owner": clip_list.best.owner,
            "origin": clip_list.best.shows,
            "gender": body.gender,
            "baked": self.baked,
            "edges_m": _text(lengths_m, "<f4"),
            "vertices": body.vertex_count,
            "parts": PARTS,
            "part_weights": _text(part_weights(body).T, "<f4"),
            "largest_strain": LARGEST_STRAIN,
            "most_frames": MOST_FRAMES,
            "start": {
                "gain": controls.get("gain", 1.0),
                "parts": gains_of_parts(controls.get("part_gain", ())).tolist(),
                "loop": controls.get("loop", False),
            },
            "labels": {SMPL_ALONE: "SMPL alone", **clip_list.predictors, TRUTH: TRUTH},
            "motions": [self.entry(number) for number in range(len(self._clips))],
        }
        return json.dumps(facts | self._facts_of_skinning() | self._facts_of_skin()).encode()

    def _facts_of_skin(self) -> dict[str, Any]:
        """The body's faces; or those of its picture, the asset `skin`, and how it lies on the body:
        see `SplitMesh`."""
        body = self.body
        if self._skin_png is None or body.texture is None:
            return {"faces": _text(body.faces, "<u2" if body.vertex_count < 1 << 16 else "<u4")}
        split = split_at_seams(body.faces, body.texture)
        places = np.rint(split.places * 65535)
        skin = {
            "faces": _text(split.faces, "<u2"),
            "copy_of": _text(split.vertex[body.vertex_count :], "<u2"),
            "places": _text(places, "<u2"),
        }
        return {"skin": skin}

    def _facts_of_skinning(self) -> dict[str, Any]:
        """Skinning weights and facts of the graph; without a graph one bone moves all vertices."""
        body, plus = self.body, self._plus
        weights = bone_weights(body) if plus else np.ones((body.vertex_count, 1))
        most_bones = int((weights > 0).sum(axis=1).max())
        bones = np.argsort(-weights, axis=1, kind="stable")[:, :most_bones]
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
        """Betas by name: the clip list's, and those of `SHAPES` that this body can have."""
        shapes = {name: betas.tolist() for name, betas in self._clip_list.shapes.items()}
        for name in SHAPES:
            try:
                shapes[name] = find_shape(self.body, [name]).tolist()
            except DsnetError:  # this body cannot have it
                continue
        return json.dumps(shapes).encode()

    def _tracks(self, clip: Clip) -> list[str]:
        """Names of a clip's tracks: all predictors but the live one, and the truth if known."""
        names = [name for name in self._clip_list.predictors if name != self._live]
        truth = [TRUTH] if self._clip_list.truth_of(clip) else []
        return [SMPL_ALONE] * (not self._plus) + names + truth

    def _shown(self, clip: Clip) -> Motion:
        """The part of a motion that the page shows."""
        most = TRACK_FRAMES if self._tracks(clip) else MOST_FRAMES
        truth = self._clip_list.truth_of(clip)
        return clip.read().frames(slice(min(most, truth.length) if truth else most))

    def _motion(self, number: int) -> bytes:
        clip = self.clip(number)
        whole, motion = len(clip.read().theta), self._shown(clip)
        told = clip.told
        warnings = motion_warnings(motion) if told is None else [*told]
        if (left_out := whole - len(motion.theta)) and not self._clip_list.truth_of(clip):
            warnings.append(f"{left_out} of its {whole} frames are left out: pages show less")
        starts = [piece.start for piece in motion.pieces]
        return self._motion_json(number, motion, motion.theta, starts=starts, says=warnings)

    def _motion_json(self, number: int, motion: Motion, theta: NDArray, **more: Any) -> bytes:
        first = motion.frames(slice(1))
        by_joint = [
            first.about_root_joint(axis).trans_m[0] - first.trans_m[0] for axis in np.eye(3)
        ]
        facts = {
            "name": self._clips[number][0],
            "theta": _text(theta, "<f8"),
            "betas": motion.betas.tolist(),
            "fps": motion.fps,
            "first": 0,
            "count": len(theta),
            # Derivative of the root's translation by the root joint, which depends on the shape.
            "by_joint": np.transpose(by_joint).tolist(),
        }
        return json.dumps(facts | more).encode()

    def _loop_asset(self, number: int) -> bytes:
        """The motion as a loop: the cycle that is shown, after others that warm the tissue up."""
        motion = self._shown(self.clip(number))
        try:
            if len(motion.pieces) > 1:
                raise DsnetError("a motion with cuts", "one without", "Choose another.")
            loop = close_loop(motion.theta, root_joint_m(self.body, motion.betas))
        except DsnetError as error:
            return json.dumps({"failed": str(error)}).encode()
        count = len(loop.theta)
        before = max(2, int(np.ceil(_WARM_UP_S * motion.fps / count)))
        theta = cycles_around(loop, before, _FRAMES_AHEAD)
        shown = {"first": before * count, "count": count}
        return self._motion_json(number, motion, theta, starts=[0], says=[], **shown)

    def _track(self, number: int, name: str) -> bytes:
        """The resolution in metres (float32), then (T, 3, V) differences in time (int16)."""
        frames = np.concatenate([part.transpose(0, 2, 1) for part in self._track_m(number, name)])
        step_m = max(STEP_M, float(np.abs(frames).max()) / 32_000)
        steps = np.rint(frames / step_m).astype(np.int16)
        differences = np.diff(steps, axis=0, prepend=np.zeros_like(steps[:1]))
        return np.float32(step_m).tobytes() + differences.astype("<i2").tobytes()

    def _track_m(self, number: int, name: str) -> Iterator[NDArray]:
        """Pieces (T', V, 3) of a track, metres.

        Offsets in the rest pose of the motion, also of a truth with another pose, so that its posed
        vertices are right. In a baked page offsets are posed, and SMPL alone is relative to the
        root.
        """
        clip = self.clip(number)
        motion = self._shown(clip)
        pose, trans_m = pose_on(motion, self.body), motion.trans_m
        alone = Smpl(self.body).person(motion.betas)
        if name == SMPL_ALONE:
            yield alone.pose(pose, 0 * trans_m)
        elif name != TRUTH and not self.baked:
            moving = MovingBody(self._clip_list.open(name), motion)
            yield from (piece.offsets_m for piece in moving)
        else:
            for frames, vertices_m in self._posed(name, clip, motion):
                places_m, turns = alone.skin(pose[frames], trans_m[frames])
                apart_m = vertices_m - places_m
                yield apart_m if self.baked else np.linalg.solve(turns, apart_m[..., None])[..., 0]

    def _posed(self, name: str, clip: Clip, motion: Motion) -> Iterator[tuple[slice, NDArray]]:
        """Vertices in the world, some frames at a time."""
        truth, sequence = self._clip_list.truth, clip.sequence
        if name != TRUTH or truth is None:
            moving = MovingBody(self._clip_list.open(name), motion, loop=self._loop)
            yield from ((piece.frames, piece.vertices_m) for piece in moving)
            return
        person = Smpl(self.body).person(truth.betas(sequence))
        for start in range(0, len(motion.theta), _FRAMES_AT_ONCE):
            frames = slice(start, min(start + _FRAMES_AT_ONCE, len(motion.theta)))
            pose, trans_m = unpack_theta(truth.frames("theta", sequence, frames))
            yield frames, person.pose(pose, trans_m, truth.offsets_m(sequence, frames))


def cycles_around(loop: Loop, before: int, ahead: int) -> NDArray[np.floating]:
    """theta (T, 69) of a loop with `before` cycles before it and `ahead` frames after it.

    Each cycle ends where the next one begins.
    """
    unturned = Rotation.from_rotvec([0.0, -loop.turn_rad, 0.0])
    back = replace(loop, turn_rad=-loop.turn_rad, shift_m=-unturned.apply(loop.shift_m))
    cycles = back.repeated(before + 1).reshape(before + 1, *loop.theta.shape)[::-1]
    return np.concatenate([*cycles, loop.repeated(2)[len(loop.theta) :][:ahead]])


def _text(array: NDArray, dtype: str) -> str:
    return base64.b64encode(np.ascontiguousarray(array, dtype).tobytes()).decode("ascii")
