"""`OMP_WAIT_POLICY=passive python -m benchmarks.alignment.gradients --out FILE.json`.

CPU time of one step's derivatives, by hand and by PyTorch, in turns within one process; takes some
minutes. Threads that wait actively would count as busy, hence the policy.

Of the paper's mesh distance at 6890 vertices, for as many bodies as the stage has at once (shapes
of 5 people, 20 sequences of the demo, the largest group): by hand, as shipped; by autograd; by
autograd patch by patch, so that each stays in the cache; and with only the bones left to autograd.
Bones are chained as in `JointTree`, the skin is planar: what autograd is fastest with.

Of the robust aligner's 800 vertices: the Jacobian by hand, as shipped, and `torch.func.jacfwd`.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import torch
from torch import Tensor

from benchmarks.processes import run_as_process
from bridge.body import load_body_model
from bridge.options import PositiveInt
from bridge.paper import N_JOINTS
from bridge.runs.files import write_text_atomically
from bridge.runs.writer import machine
from torch_align_ae.alignment.gauss_newton import moved
from torch_align_ae.alignment.joint_tree import Bones
from torch_align_ae.alignment.mesh_distance import MeshDistance
from torch_align_ae.alignment.skin_sample import Pose, SkinSample
from torch_align_ae.body import SMPL
from torch_align_ae.body.rotations import axis_angle_to_matrix

_AT_ONCE = 2
_VERTICES = 800
Way = Callable[[], tuple[Tensor, ...]]


@dataclass(frozen=True)
class GradientsConfig:
    """Measure, and write a .json."""

    out: Path
    """The file."""
    bodies: tuple[PositiveInt, ...] = (5, 20, 40)
    """Bodies of one step of the paper's aligner."""
    frames: PositiveInt = 32
    """Frames of one step of the robust aligner."""
    rounds: PositiveInt = 20
    """Turns of each way; the fastest counts."""


def main(config: GradientsConfig) -> None:
    """Measure with one thread and with two."""
    smpl = SMPL(load_body_model("embedded:female"))
    cases = {f"gradient, {count} bodies": gradient_ways(smpl, count) for count in config.bodies}
    cases[f"jacobian, {config.frames} frames"] = jacobian_ways(smpl, config.frames)
    before, found = torch.get_num_threads(), {}
    for threads in (1, 2):
        torch.set_num_threads(threads)
        found[f"threads: {threads}"] = {
            case: _measured(ways, config.rounds) for case, ways in cases.items()
        }
    torch.set_num_threads(before)
    text = json.dumps({"machine": machine(), "torch": torch.__version__, **found}, indent=1)
    write_text_atomically(config.out, text + "\n")


def _measured(ways: dict[str, Way], rounds: int) -> dict[str, dict[str, float]]:
    fastest_s = dict.fromkeys(ways, float("inf"))
    for _ in range(rounds):
        for name, way in ways.items():
            begun = time.process_time()
            for _ in range(_AT_ONCE):
                way()
            fastest_s[name] = min(fastest_s[name], (time.process_time() - begun) / _AT_ONCE)
    by_hand_s = next(iter(fastest_s.values()))
    return {
        name: {"cpu_ms": round(1e3 * s, 3), "ratio": round(s / by_hand_s, 2)}
        for name, s in fastest_s.items()
    }


def gradient_ways(smpl: SMPL, count: int) -> dict[str, Way]:
    """Ways to the gradient of B distances by pose and translation; the first is what is shipped."""
    generator = torch.Generator().manual_seed(0)
    betas = torch.randn(count, 10, generator=generator)
    pose = 0.3 * torch.randn(count, N_JOINTS, 3, generator=generator)
    trans = torch.randn(count, 3, generator=generator)
    objective = MeshDistance(smpl)
    shapes = objective.shapes(betas)
    target = objective.arrange(smpl(betas, pose + 0.05, trans + 0.02))
    distance = objective.to(target)

    @torch.inference_mode()
    def by_hand() -> tuple[Tensor, ...]:
        found = distance.gradient(shapes, pose, trans)
        return found.pose, found.trans

    @torch.no_grad()
    def of_skin_by_hand(bones: Bones) -> tuple[Tensor, ...]:
        distances, by_transforms, by_features = distance.of_skin(shapes, bones)
        scale = 1 / distances[:, None]
        return torch.nn.functional.pad(by_features * scale, (1, 0)), by_transforms * scale

    def of_patches(patches: list[list[Tensor]], bones: Bones) -> tuple[Tensor, ...]:
        leaves = [part.requires_grad_() for part in (bones.pose_features, bones.T_world_rest)]
        found, squared = [torch.zeros_like(leaf) for leaf in leaves], torch.zeros(count)
        for patch in patches:
            one = _squared_distance(patch, bones)
            for total, part in zip(found, torch.autograd.grad(one.sum(), leaves), strict=True):
                total += part
            squared += one.detach()
        scale = 0.5 / squared.sqrt()[:, None]
        return tuple(total * scale for total in found)

    def through_bones(of_bones: Callable[[Bones], tuple[Tensor, ...]]) -> tuple[Tensor, ...]:
        variables = pose.clone().requires_grad_(), trans.clone().requires_grad_()
        bones = _bones(smpl.parents[:N_JOINTS], shapes.joints, *variables)
        features, rest = bones.pose_features, bones.T_world_rest
        detached = bones._replace(pose_features=features.detach(), T_world_rest=rest.detach())
        return torch.autograd.grad((features, rest), variables, of_bones(detached))

    patches = _patches(objective, shapes.vertices, target)
    whole = _whole(smpl, objective.restore(shapes.vertices), objective.restore(target))
    return {
        "by hand": by_hand,
        "autograd": partial(through_bones, partial(of_patches, [whole])),
        "autograd, patch by patch": partial(through_bones, partial(of_patches, patches)),
        "bones by autograd, skin by hand": partial(through_bones, of_skin_by_hand),
    }


def _patches(objective: MeshDistance, shaped: Tensor, target: Tensor) -> list[list[Tensor]]:
    sizes = [3 * len(patch.vertices) for patch in objective.patches]
    parts = zip(objective.patches, shaped.split(sizes, 1), target.split(sizes, 1), strict=True)
    return [
        [patch.bones, patch.weights, patch.features, patch.posedirs, *planes]
        for patch, *planes in parts
    ]


def _whole(smpl: SMPL, shaped: Tensor, target: Tensor) -> list[Tensor]:
    """The whole skin as one patch."""
    posedirs = smpl.posedirs[: 9 * (N_JOINTS - 1)].flatten(1)
    planes = [mesh.mT.flatten(1) for mesh in (shaped, target)]
    return [
        torch.arange(N_JOINTS),
        smpl.moving_weights(),
        torch.arange(len(posedirs)),
        posedirs,
        *planes,
    ]


def _squared_distance(patch: list[Tensor], bones: Bones) -> Tensor:
    """(B,) of a patch, m^2."""
    which, weights, those, posedirs, shaped, target = patch
    count, size = len(target), weights.shape[1]
    features = bones.pose_features[..., 1:].permute(2, 3, 0, 1).flatten(1)
    transforms = bones.T_world_rest.permute(2, 1, 0, 3).flatten(0, 2)
    rest = torch.addmm(shaped, features[:, those], posedirs).view(count, 3, size)
    blended = (transforms[:, which] @ weights).view(count, 4, 3, size)
    residual = blended[:, 3] - target.view(count, 3, size)
    for axis in range(3):
        residual = residual.addcmul(blended[:, axis], rest[:, axis, None])
    return residual.square().sum((1, 2))


def _bones(parents: tuple[int, ...], joints: Tensor, pose: Tensor, trans: Tensor) -> Bones:
    """`JointTree.move` for autograd: the same numbers in few operations."""
    features = (axis_angle_to_matrix(pose) - torch.eye(3)).permute(2, 3, 0, 1)
    joints, above, world = joints.permute(2, 0, 1), [*parents], len(parents)
    root = joints[..., :1] + trans.T[..., None]
    local = torch.cat([root, joints[..., 1:] - joints[..., above[1:]]], 2)
    frames = torch.cat([features, local[:, None]], 1)
    frames = torch.nn.functional.pad(frames, (0, 1, 0, 0, 0, 0, 0, 1))
    frames = frames + torch.eye(4)[:, :, None, None]
    above = [world, *above[1:], world]
    while set(above) != {world}:  # a round doubles the number of joints behind a frame
        frames = (frames[..., above][:, :, None] * frames).sum(1)
        above = [above[joint] for joint in above]
    turn, place = frames[:3, :3, :, :-1], frames[:3, 3, :, :-1]
    rest = torch.cat([turn, (place - (turn * joints).sum(1))[:, None]], 1)
    return Bones(features, features, frames, rest)


def jacobian_ways(smpl: SMPL, count: int) -> dict[str, Way]:
    """Ways to a sample's derivatives (B, 69, 3, N); the first is what is shipped."""
    sample = SkinSample(smpl, _VERTICES)
    generator = torch.Generator().manual_seed(0)
    turns = 0.3 * torch.randn(count, N_JOINTS, 3, generator=generator)
    pose = Pose(axis_angle_to_matrix(turns), torch.zeros(count, 3))
    shaped = sample.shaped(torch.zeros(10))
    alike = torch.ones(len(sample))

    def by_hand() -> tuple[Tensor, ...]:
        posed = shaped.posed(pose)
        found = torch.zeros(count, N_JOINTS + 1, 3, 3, len(sample))
        for patch in sample.patches:
            own = patch.linearise(posed, alike[patch.vertices])[1]
            found[:, [*patch.joints.tolist(), N_JOINTS], ..., patch.vertices] = own
        return (found.flatten(1, 2),)

    def forward_mode() -> tuple[Tensor, ...]:
        posed = shaped.posed(pose)

        def after(change: Tensor) -> Tensor:
            return shaped.posed(moved(posed, change.expand(count, -1))).positions()

        found = torch.func.jacfwd(after)(torch.zeros(3 * N_JOINTS + 3))
        return (found.permute(0, 3, 1, 2),)

    return {"by hand": by_hand, "torch.func.jacfwd": forward_mode}


if __name__ == "__main__":
    run_as_process(GradientsConfig, main)
