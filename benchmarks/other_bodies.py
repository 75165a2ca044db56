"""`dsnet_plus` on other bodies than its own: frames a second, and what preparing a body takes.

    python -m benchmarks.other_bodies --out docs/results/prediction/other_bodies.json

The embedded body in other clothes, in turns, processor time of one thread, so that others may use
the machine. Half a minute.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from bridge.body import BodyModelData, load_body_model
from bridge.motion import load_motion
from bridge.runs.writer import machine
from dsnet.prediction.load_model import TrainedModel, load_model
from dsnet.prediction.moving_body import MovingBody

ROUNDS, FRAMES = 7, 128


def renumbered(body: BodyModelData, seed: int = 0) -> tuple[BodyModelData, NDArray[np.intp]]:
    """The same surface, its vertices and faces shuffled; which old vertex each new one is."""
    rng = np.random.default_rng(seed)
    order = rng.permutation(body.vertex_count)
    number = np.empty_like(order)
    number[order] = np.arange(len(order))
    other = replace(
        body,
        name="renumbered",
        v_template=body.v_template[order],
        shapedirs=body.shapedirs[order],
        posedirs=body.posedirs[order],
        weights=body.weights[order],
        J_regressor=body.J_regressor[:, order],
        faces=rng.permutation(number[body.faces]),
        texture=None,
    )
    return other, order


def cut_finer(body: BodyModelData, count: int = 10_475, seed: int = 0) -> BodyModelData:
    """The same surface of more vertices: the old ones, then middles of edges."""
    rng = np.random.default_rng(seed)
    faces = [tuple(face) for face in body.faces.tolist()]
    of_edge: dict[tuple[int, int], list[int]] = {}
    for number, face in enumerate(faces):
        for one, two in zip(face, face[1:] + face[:1], strict=True):
            of_edge.setdefault((min(one, two), max(one, two)), []).append(number)
    ends: list[tuple[int, int]] = []
    touched: set[int] = set()
    left = count - body.vertex_count
    edges = list(of_edge)
    for index in rng.permutation(len(edges)):
        edge = edges[index]
        beside = of_edge[edge]
        if len(ends) == left:
            break
        if len(beside) != 2 or touched.intersection(beside):
            continue
        touched.update(beside)
        middle = body.vertex_count + len(ends)
        ends.append(edge)
        for number in beside:
            face = faces[number]
            apex = next(v for v in face if v not in edge)
            at = face.index(apex)
            _, one, two = face[at:] + face[:at]
            faces[number] = (apex, one, middle)
            faces.append((apex, middle, two))
    assert len(ends) == left
    return _with_middles(body, np.array(ends), np.array(faces))


def cut_in_four(body: BodyModelData) -> BodyModelData:
    """The same surface, each face cut into four."""
    corners = body.faces
    sides = np.sort(np.stack([corners, np.roll(corners, -1, 1)], axis=2), axis=2).reshape(-1, 2)
    ends, edge = np.unique(sides, axis=0, return_inverse=True)
    one, two, three = (edge.reshape(-1, 3) + body.vertex_count).T
    first, second, third = corners.T
    faces = [(first, one, three), (one, second, two), (three, two, third), (one, two, three)]
    return _with_middles(body, ends, np.concatenate([np.stack(face, axis=1) for face in faces]))


def _with_middles(body: BodyModelData, ends: NDArray, faces: NDArray) -> BodyModelData:
    def more(values: NDArray) -> NDArray:
        return np.concatenate([values, values[ends].mean(axis=1)])

    nothing = sp.csr_matrix((len(body.parents), len(ends)))
    return replace(
        body,
        name="cut finer",
        v_template=more(body.v_template),
        shapedirs=more(body.shapedirs),
        posedirs=more(body.posedirs),
        weights=more(body.weights),
        J_regressor=sp.hstack([body.J_regressor, nothing], format="csr"),
        faces=faces,
    )


def prepared(body: BodyModelData | None) -> tuple[TrainedModel, dict[str, float]]:
    """The packaged model on a body, and what opening it takes: the first time, then from what was
    kept of that."""
    home = load_model(None)
    if body is None:
        return home, {}
    with tempfile.TemporaryDirectory() as folder:
        os.environ["XDG_CACHE_HOME"] = folder
        took_s = {}
        for name in ("first_s", "kept_s"):
            trained, began = home.on(body, body.name), time.process_time()
            _ = trained.model
            took_s[name] = time.process_time() - began
    return trained, took_s


def main(out: Path) -> None:
    """Measure, print and write."""
    home = load_body_model("embedded:female")
    bodies = {
        "its own": None,
        "another order": renumbered(home)[0],
        "10,475 vertices": cut_finer(home),
        "27,554 vertices": cut_in_four(home),
    }
    moving, found = {}, {}
    motion = load_motion(Path("sample:jumping_jacks")).frames(slice(FRAMES))
    for name, body in bodies.items():
        trained, found[name] = prepared(body)
        moving[name] = MovingBody(trained, motion)
        found[name]["frames_per_s"] = []
    for _ in range(ROUNDS):
        for name, one in moving.items():
            began = time.process_time()
            assert sum(len(part.vertices_m) for part in one) == FRAMES
            found[name]["frames_per_s"].append(FRAMES / (time.process_time() - began))
    for name, numbers in found.items():
        numbers["median_frames_per_s"] = float(np.median(numbers["frames_per_s"]))
        print(name, {n: round(v, 2) for n, v in numbers.items() if not isinstance(v, list)})
    out.write_text(
        json.dumps({"machine": machine(), "bodies": found}, indent=1) + "\n", encoding="utf-8"
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    main(parser.parse_args().out)
