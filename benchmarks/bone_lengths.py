"""What lengths of bones tell of a person's flesh, as files of joints have them.

    python -m benchmarks.bone_lengths --out docs/results/skin_markers/bone_lengths.json

Betas of people drawn at random, to bones between SMPL's 22 joints, to fitted betas: how far their
skin is from the true one's, and how far the size of the flesh's movement in jumping jacks is from
the true person's, beside the mean shape. Joints of another skeleton, or of people in motion, are
off: by `NOISE_M` in each length. BVHs have no unit, so only ratios to the legs. Some minutes.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.body.posing import shaped_joints, shaped_vertices
from bridge.motion import load_motion
from bridge.paper import N_BETAS, N_JOINTS
from dsnet.prediction.load_model import load_model
from dsnet.prediction.models import Model, codes_of_several

PEOPLE, FRAMES, NOISE_M, SEED = 30, 90, 0.01, 0
_EXACT_M, _ROUNDS, _STEP = 0.002, 12, 0.1
_LEG = [3, 6]
"""Left thigh and shin among the bones."""


def bones_m(body: BodyModelData, betas: NDArray) -> NDArray[np.float64]:
    """(21,) lengths from each joint to its parent."""
    joints = shaped_joints(body, betas[None])[0, :N_JOINTS]
    return np.linalg.norm(joints[1:] - joints[body.parents[1:N_JOINTS]], axis=1)


def fitted(body: BodyModelData, lengths: NDArray, off_m: float, ratios: bool) -> NDArray:
    """(10,) betas nearest to zero of lengths (21,) that are off by so much."""

    def seen(lengths: NDArray) -> NDArray:
        return lengths / lengths[_LEG].sum() if ratios else lengths

    betas = np.zeros(N_BETAS)
    off = off_m / (bones_m(body, betas)[_LEG].sum() if ratios else 1)
    for _ in range(_ROUNDS):
        here = seen(bones_m(body, betas))
        steps = betas + _STEP * np.eye(N_BETAS)
        by_beta = np.stack([(seen(bones_m(body, one)) - here) / _STEP for one in steps], axis=1)
        wanted = by_beta.T @ (seen(lengths) - here) / off**2 - betas
        betas = betas + np.linalg.solve(by_beta.T @ by_beta / off**2 + np.eye(N_BETAS), wanted)
    return betas


def flesh_mm(model: Model, people: NDArray) -> NDArray[np.float64]:
    """(B,) root mean square of the nodes' offsets, of people (B, 10) who all move alike."""
    theta = load_motion(Path("sample:jumping_jacks")).theta[:FRAMES]
    found = [codes for _, codes in codes_of_several(model, [theta] * len(people), people)]
    return 1e3 * np.sqrt(np.mean(np.square(found), axis=(0, 2, 3)) * 3)


def measured(gender: str) -> dict[str, dict[str, float]]:
    """Mean errors by what is known of a person."""
    trained = load_model(None, gender=gender)
    body, rng = trained.body, np.random.default_rng(SEED)
    people = rng.normal(size=(PEOPLE, N_BETAS))
    lengths = np.array([bones_m(body, betas) for betas in people])
    noisy = lengths + rng.normal(0, NOISE_M, lengths.shape)
    guesses = {
        "mean shape": np.zeros_like(people),
        "exact lengths": np.array([fitted(body, one, _EXACT_M, False) for one in lengths]),
        "lengths": np.array([fitted(body, one, NOISE_M, False) for one in noisy]),
        "ratios": np.array([fitted(body, one, NOISE_M, True) for one in noisy]),
    }
    true_mm, errors = flesh_mm(trained.model, people), {}
    true_m = _about_middle(shaped_vertices(body, people))
    for name, betas in guesses.items():
        apart_m = _about_middle(shaped_vertices(body, betas)) - true_m
        off = np.abs(flesh_mm(trained.model, betas) / true_mm - 1)
        errors[name] = {
            "skin_mm": float(1e3 * np.linalg.norm(apart_m, axis=-1).mean()),
            "flesh_off_percent": float(100 * off.mean()),
        }
    return errors


def _about_middle(vertices_m: NDArray) -> NDArray:
    return vertices_m - vertices_m.mean(axis=1, keepdims=True)


def main(out: Path) -> None:
    """Measure, print and write."""
    found = {gender: measured(gender) for gender in ("female", "male")}
    print(json.dumps(found, indent=1))
    facts = {"people": PEOPLE, "noise_m": NOISE_M, "seed": SEED}
    out.write_text(json.dumps(facts | found, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    main(parser.parse_args().out)
