"""Markers with known truth: sampled from a body whose offsets are known, with noise and gaps."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.prediction.marker_pose import EMBEDDED_MARKERS as VERTICES
from bridge.body import BodyModelData
from bridge.body.posing import Smpl
from bridge.motion import Motion, unpack_theta
from bridge.motion.motion import Y_UP_FROM_Z_UP
from bridge.motion.readers.amass import motion_path
from dsnet.markers.marker_files import Markers, load_recording, markers_of


@dataclass(frozen=True, eq=False)
class Known:
    body: BodyModelData
    motion: Motion
    offsets_m: NDArray


def sampled(known: Known, noise_m: float = 0.0, gaps: float = 0.0) -> NDArray[np.float64]:
    """(T, N, 3) places of `VERTICES` on the known skin, metres, z up; NaN in gaps."""
    rng = np.random.default_rng(7)
    ids = list(VERTICES.values())
    pose, trans = unpack_theta(known.motion.theta)
    person = Smpl(known.body, np.array(ids), np.float64).person(known.motion.betas)
    skin = person.pose(pose, trans, known.offsets_m[:, ids])
    z_up = Y_UP_FROM_Z_UP.inv().apply(skin.reshape(-1, 3)).reshape(skin.shape)
    z_up += noise_m * rng.standard_normal(z_up.shape)
    for marker in range(len(ids)):
        for start in np.flatnonzero(rng.random(len(z_up)) < gaps / 5):
            z_up[start : start + 5, marker] = np.nan
    return z_up


def pose_arrays() -> dict[str, NDArray]:
    """What AMASS's file of the known motion holds beside markers."""
    with np.load(motion_path("sample:jumping_jacks")) as stored:
        return dict(stored)


def marker_file(
    path: Path, known: Known, noise_m: float = 0.0, gaps: float = 0.0, scale: float = 1.0
) -> Path:
    """An AMASS file whose markers ride on the known skin."""
    points = scale * sampled(known, noise_m, gaps)
    labels = np.array(list(VERTICES))
    arrays: dict[str, Any] = {"marker_data": points, "marker_labels": labels, **pose_arrays()}
    np.savez(path, **arrays)
    return path


def markers_in(path: Path, fps: float | None = None) -> Markers:
    """The markers beside a file's pose, at another rate than it says where one is given."""
    return markers_of(load_recording(path, fps))


def stageii(known: Known, per_frame: int = 1) -> dict[str, Any]:
    """What MoSh++ pickles: lists of each frame's markers, and all sorts of things beside."""
    pose, points, labels = pose_arrays(), sampled(known), list(VERTICES)
    return {
        "fullpose": pose["poses"],
        "trans": pose["trans"],
        "betas": pose["betas"],
        "markers_latent": np.zeros((len(labels), 3)),
        "latent_labels": labels,
        "markers_latent_vids": dict(VERTICES),
        "marker_meta": {"marker_vids": OrderedDict(VERTICES), "surface_model_type": "smplh"},
        "stageii_debug_details": {
            "stageii_errs": {"data": np.zeros(len(points))},
            "markers_sim": list(points),
            "markers_obs": list(points),
            "labels_obs": [list(labels) for _ in points],
            "markers_orig": points,
            "labels_orig": labels,
            "mocap_fname": "take.c3d",
            "mocap_frame_rate": 60.0 * per_frame,
            "cfg": {"surface_model": {"gender": "female"}, "mocap": {"ds_rate": per_frame}},
        },
    }


def older_stageii(known: Known) -> dict[Any, Any]:
    """MoSh++'s older layout: names by frame, of markers that were seen in it, and text of NumPy."""
    pose, points = pose_arrays(), sampled(known, gaps=0.02)
    labels, seen = np.array(list(VERTICES)), np.asarray(np.isfinite(points).all(axis=2))
    fields = {
        "pose_est_fullposes": pose["poses"],
        "pose_est_trans": pose["trans"],
        "shape_est_betas": pose["betas"],
        "pose_est_obmrks": [places[own] for places, own in zip(points, seen, strict=True)],
        "pose_est_mrk_labels": [list(labels[own]) for own in seen],
        "mocap_framerate": 60.0,
        "ps": {"gender": np.str_("female"), "fitting_model": "smplh"},
    }
    return {np.str_(name): value for name, value in fields.items()}
