"""Recordings of markers with no pose beside them, as gait laboratories have: what skin does beyond
bone by the markers alone, and the motion of a body that is fitted to those on bone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.body.model_data import SMPL_JOINT_NAMES
from bridge.errors import DsnetError, notify
from bridge.motion import Motion, pack_theta
from bridge.motion.directions import unit
from bridge.motion.markers import MarkerFile
from bridge.motion.readers.recordings import recording
from bridge.motion.resampling import resampled_frames
from bridge.motion.smoothing import continuous_rotations, smoothed
from bridge.paper import FPS
from dsnet.markers.bony_fit import FEWEST, fit_body, markers_to_fit
from dsnet.markers.marker_files import Markers, checked_markers
from dsnet.markers.segments import CUT_HZ, SEGMENTS, SIDES, Cloud, Pose, faster, segment_frames
from dsnet.markers.skin import Size, at_spots, floor_mm, size_of

_SMOOTH_HZ = 12.0
"""What is faster in a pose that is fitted to each frame is noise of its markers."""
_WORST = 3
_HIPS = (0.36, -0.30, -0.22)
"""A hip joint from the middle of the two ASIS, in their distances: to the side, up and to the front
(Bell, Pedersen and Brand 1990: 14 % inward of the ASIS, 30 % below and 22 % behind it)."""
_FRONT, _TRUNK = ("ASI", "FWT"), ("ASI", "PSI", "FWT", "BWT", "SHO")


@dataclass(frozen=True, eq=False)
class Lone:
    """A recording without a pose: its file, and its markers, checked, y up."""

    file: MarkerFile
    markers: Markers

    @classmethod
    def read(cls, path: Path, fps: float | None = None) -> Lone:
        """`DsnetError` if they are no markers of one person; `fps` where the file's is wrong."""
        file = recording(path)
        return cls(file, checked_markers(file, fps))

    def cloud(self) -> Cloud:
        """The markers that are seen often enough, at the paper's rate."""
        rows = len(self.markers.points_m)
        return self.markers.at(FPS, resampled_frames(rows, self.markers.fps))


@dataclass(frozen=True, eq=False)
class AloneRow:
    """What one marker does in its segment's frame; x to the left, y up, z to the front."""

    label: str
    region: str
    segment: str
    doubt: str
    seen: float
    slow_rms_mm: list[float]
    """What is slower than `CUT_HZ`: skin that slides with the pose, and the frame's drift."""
    fast: Size
    """What is faster."""
    fast_mm: NDArray[np.float64]
    """(T, 3) for a figure, NaN where it was not seen."""


@dataclass(frozen=True, eq=False)
class Alone:
    """All soft markers of a recording."""

    rows: list[AloneRow]
    floor_mm: dict[str, list[float]]
    """rms in x, y, z of a marker on bone in the frame of the others."""

    def summary(self) -> dict:
        """What goes into a JSON file: no curves."""
        rows = [vars(row) | {"fast": vars(row.fast)} for row in self.rows]
        for row in rows:
            del row["fast_mm"]
        return {"above_hz": CUT_HZ, "rows": rows, "floor_rms_mm": self.floor_mm}


def measure_alone(lone: Lone) -> Alone:
    """The motion of soft markers beyond bone; `DsnetError` if there are none, or none on bone of
    their segment."""
    cloud = lone.cloud()
    pose = _heading(cloud)
    frames = segment_frames(cloud, pose)
    if not _sided(cloud, _FRONT):  # nobody knows where the hip joints are
        frames = {name: one for name, one in frames.items() if not name.endswith("thigh")}
    rows = []
    for label, spot, moved_mm, good in at_spots(cloud, frames, FPS):
        fast_mm = faster(moved_mm, FPS)
        slow_mm = (moved_mm - moved_mm.mean(axis=0) - fast_mm)[good]
        rows.append(
            AloneRow(
                label,
                spot.region,
                spot.segment,
                SEGMENTS[spot.segment].doubt.replace("the pose", "the heading"),
                round(float(good.mean()), 3),
                [round(float(rms), 2) for rms in slow_mm.std(axis=0)],
                size_of(fast_mm, good, FPS),
                np.where(good[:, None], fast_mm, np.nan),
            )
        )
    if not rows:
        names = ", ".join(lone.markers.labels[:6])
        raise DsnetError(
            f"markers {names}, ... of {lone.file.path}",
            "some on soft places (LTHI, LTIB, LUPA, LBUST, MBLLY, ...) for two seconds, and those "
            "on the bone of their segment (LASI, LPSI or SACR, LKNE, LANK; C7, T10, CLAV)",
            "Name them as Plug-in Gait or AMASS does, or pass another file.",
        )
    inner = np.ones(len(pose.bones), bool)
    return Alone(rows, floor_mm(cloud, pose, frames, inner, FPS))


def lone_motion(body: BodyModelData, lone: Lone) -> Motion:
    """The motion of a body, y up at the paper's rate, in the shape and pose that markers on bone
    tell. Says on stderr how far they are off.

    `DsnetError` if they are too few.
    """
    cloud = lone.cloud()
    labels = markers_to_fit(cloud)
    if not labels:
        raise DsnetError(
            f"{lone.file.path}, with too few markers on bone to fit a body to",
            f"{FEWEST} or more, three of them on the pelvis (LASI, RASI, LPSI, RPSI or SACR) or "
            "on the chest (C7, T10, CLAV, STRN)",
            "Put a pose of the same name beside it.",
        )
    fitted = fit_body(body, cloud, labels)
    motion = Motion(
        theta=pack_theta(continuous_rotations(fitted.pose), fitted.trans_m),
        betas=fitted.betas,
        gender=body.gender,
        fps=FPS,
        source_fps=lone.markers.fps,
        source=lone.file.path,
        kind=None if body.source == "synthetic" else body.kind,
        trans_of="y",
        embedded_betas=body.source == "synthetic",
        markers=lone.file,
    )
    notify(f"{lone.file.path}: no pose beside it: {_told(fitted.residual_mm)}")
    return smoothed(motion, _SMOOTH_HZ)


def _told(residual_mm: dict[str, float]) -> str:
    worst = sorted(residual_mm, key=lambda label: -residual_mm[label])[:_WORST]
    each = ", ".join(f"{label} {residual_mm[label]:.0f}" for label in worst)
    off_mm = float(np.median([*residual_mm.values()]))
    return (
        f"a body is fitted to {len(residual_mm)} markers on bone, which lie {off_mm:.0f} mm off "
        f"(median; most {each})"
    )


def _heading(cloud: Cloud) -> Pose:
    """In place of a pose: all bones turned about the vertical as the person is, and hip joints by
    the pelvis' markers."""
    points, count = cloud.points_m, len(next(iter(cloud.points_m.values())))
    across = [unit(points[f"L{name}"] - points[f"R{name}"]) for name in _sided(cloud, _TRUNK)]
    left = np.sum(across, axis=0) if across else np.tile([1.0, 0, 0], (count, 1))
    left = unit(left * [1, 0, 1])
    up = np.tile([0.0, 1, 0], (count, 1))
    axes = np.stack([left, up, np.cross(left, up)], axis=2)  # (T, 3, axis)
    bones = np.tile(np.eye(4), (count, len(SMPL_JOINT_NAMES), 1, 1))
    bones[..., :3, :3] = axes[:, None]
    joints_m = np.zeros((count, len(SMPL_JOINT_NAMES), 3))
    for front in _sided(cloud, _FRONT)[:1]:
        one, other = points[f"L{front}"], points[f"R{front}"]
        apart_m = np.linalg.norm(one - other, axis=1)[:, None]
        for letter, side in SIDES.items():
            way = np.array(_HIPS) * [1 if letter == "L" else -1, 1, 1]
            row = SMPL_JOINT_NAMES.index(f"{side}_hip")
            joints_m[:, row] = (one + other) / 2 + apart_m * (axes @ way)
    return Pose(bones, joints_m)


def _sided(cloud: Cloud, names: Sequence[str]) -> list[str]:
    """Those that have a marker on either side."""
    return [name for name in names if {f"L{name}", f"R{name}"} <= cloud.points_m.keys()]
