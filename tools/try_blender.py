"""Import what `dsnet export` writes into Blender, and compare it with what `dsnet predict` writes;
read the FBX and GLB that Blender writes of an exported BVH, and compare them with that; press the
button of the extension (`tools.try_blender_extension`).

    python -m tools.try_blender

By the steps that `docs/export.md` tells, read from that page, in the Blender that PyPI has as a
wheel: it is installed into a temporary folder (a gigabyte, removed at the end) under the one
Python that it is built for. Where it cannot be had, one line says why and nothing is tried; a body
that stands elsewhere than it should fails the command. Two to five minutes.
"""

from __future__ import annotations

import json
import re
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bridge.body.model_data import SMPL_JOINT_NAMES
from bridge.body.posing import posed_joints
from bridge.body.surface_operators import vertex_normals
from bridge.motion import load_motion
from dsnet.prediction.controls import Controls, controlled_body
from tools.built_wheel import ROOT
from tools.try_blender_extension import body_vertices, extension_works, gltf_of
from tools.try_pythons import find_python, last_line, run, say

PYTHON, BLENDER = "3.11", "bpy==4.5.15"
PACKAGES = (BLENDER, "numpy==1.26.4")  # its add-ons would need more
IMPORTER = ROOT / "tools" / "blender_import.py"
INSTALL_S, COMMAND_S = 150, 180
"""At most, for the packages and for each command after them."""
DSNET = (sys.executable, "-c", "from dsnet.cli import main; main()")
MOTION, FPS, TRIED = ("--motion", "sample:walking"), 60, 5
BOUND_MM, MARGIN_MM = 0.01, 0.02
"""Vertices may be so far off; in the skeleton, so much further than its file states."""
ALLOWED = {
    "height_m": (1.6, 1.9),
    "lowest_m": (-0.01, 0.01),
    "normals_off_deg": (0, 1),
    "offset_m_off": (0, 1e-6),
    "rate_after_import": (24, 24),
    "frames_off": (0, 0),
    "bones": (24, 24),
}
"""What the page says besides where the vertices are, least and most."""
MOST_DEG, MOST_M = 1.0, 0.01
"""What it writes of a BVH may be so far from the BVH, as `dsnet` reads both."""
AXES = r"\*Forward Axis\* (-?[XYZ]) and \*Up Axis\* (-?[XYZ])"
UPRIGHT = ("height_m", "lowest_m")
OF_USD = (*UPRIGHT, "rate_after_import", "frames_off")


@dataclass(frozen=True)
class BlenderImport:
    """One way to import, and what of `ALLOWED` must hold after it."""

    name: str
    job: dict[str, Any]
    claims: tuple[str, ...] = UPRIGHT


@dataclass(frozen=True, eq=False)
class Truth:
    """What `dsnet predict` writes, at the frames tried; z up, as in Blender."""

    frames: NDArray[np.int64]
    vertices_m: NDArray[np.float32]
    joints_m: NDArray[np.float64]
    sizes_m: NDArray[np.float32]
    last: int


def main() -> int:
    """Try every format; the exit status."""
    with tempfile.TemporaryDirectory(prefix="blender_") as name:
        folder = Path(name)
        python = install(folder / "environment")
        if python is None:
            return 0
        told_ways = ways()
        make_files(folder)
        truth = read_truth(folder / "predicted")
        tried = [works(python, way, folder, truth) for way in told_ways]
        tried += [reads_what_it_writes(python, folder, suffix) for suffix in (".fbx", ".glb")]
        tried.append(extension_works(python, folder))
    return 0 if all(tried) else 1


def install(folder: Path) -> str | None:
    """The interpreter of a new environment with Blender; None, and a line, where it cannot be."""
    own = "{}.{}".format(*sys.version_info) == PYTHON
    if not (python := sys.executable if own else find_python(PYTHON)):
        say(f"not tried: {BLENDER} needs Python {PYTHON}, which is not found here")
        return None
    blenders = str(folder / "bin" / "python")
    pip = [sys.executable, "-m", "pip", "--python", blenders, "--quiet", "install"]
    for command in (
        [python, "-m", "venv", "--without-pip", str(folder)],
        [*pip, "--no-compile", "--no-deps", "--only-binary", ":all:", "--retries", "1", *PACKAGES],
        [blenders, "-c", "import bpy"],
    ):
        done = run(command, timeout=INSTALL_S)
        if done.returncode:
            say(f"not tried: {BLENDER} cannot be had: {last_line(done)}")
            return None
    return blenders


def make_files(folder: Path) -> None:
    """Predict and export, two at a time."""
    exports = {"usd": "BODY.usdz"} | {to: f"BODY.{to}" for to in ("glb", "abc", "bvh")}
    exports |= {name: name for name in ("pc2", "mdd", "obj", "ply")}
    commands = [["export", "--to", to, "--out", str(folder / out)] for to, out in exports.items()]
    commands.append(["predict", "--out", str(folder / "predicted")])
    with ThreadPoolExecutor(2) as pool:
        list(pool.map(lambda command: do([*DSNET, *command, *MOTION], ROOT), commands))


def do(command: list[str], folder: Path) -> None:
    """Run a command there; where it fails, so does this one."""
    done = run(command, cwd=folder, timeout=COMMAND_S)
    if done.returncode:
        raise SystemExit(f"{' '.join(command)} failed\n{done.stdout}{done.stderr}")


def told(formats: str, pattern: str) -> tuple[str, ...]:
    """What the page's Blender section says where it tells of some formats, or of all ("")."""
    page = (ROOT / "docs" / "export.md").read_text(encoding="utf-8")
    section = page.partition("\n## Blender\n")[2].partition("\n## ")[0]
    steps = section
    if formats:
        steps = section.partition(f"\n- **{formats}**:")[2].partition("\n- **")[0]
    if not (match := re.search(pattern, " ".join(steps.split()))):
        raise SystemExit(f"docs/export.md, Blender, {formats}: nothing there is {pattern}")
    return match.groups()


def ways() -> list[BlenderImport]:
    """Every import that the page tells, by its steps."""
    fps = int(*told("", r"Frame Rate\* to (\d+)"))
    usd = {"how": "usd", "fps": fps}
    cache = {"how": "cache", "axes": told("MDD, PC2", AXES), "time_mode": "FRAME"}
    cache["fps"] = int(*told("MDD, PC2", r"\*Time Mode\* Frame at (\d+)"))
    cache["turn_deg"] = int(*told("MDD, PC2", r"turn the object by (\d+) degrees about x"))
    pc2 = {**cache, "base": "pc2/body.obj", "path": "pc2/body.pc2"}
    mdd = {**cache, "base": "mdd/body.obj", "path": "mdd/body.mdd"}
    single = {"how": "single", "axes": told("OBJ, PLY", AXES), "fps": cache["fps"]}
    frame = "{0}/frame_{{:05d}}.{0}".format
    glb = {"how": "glb", "path": "BODY.glb", "fps": fps}
    begin = int(*told("BVH", r"begins at frame (\d+)"))
    bvh = {"how": "bvh", "path": "BODY.bvh", "fps": fps, "begin": begin}
    abc = {"how": "abc", "path": "BODY.abc", "fps": fps}
    normals, sizes = ("normals_off_deg",), ("offset_m_off",)
    return [
        BlenderImport("usd", {**usd, "path": "BODY.usdz"}, (*OF_USD, *normals, *sizes)),
        BlenderImport("glb", glb, (*UPRIGHT, "bones")),
        BlenderImport("abc", abc, (*UPRIGHT, *normals, "frames_off")),
        BlenderImport("pc2", pc2),
        BlenderImport("mdd", mdd),
        BlenderImport("mdd, by time", {**mdd, "time_mode": "TIME", "fps": 24}),
        BlenderImport("bvh", {**bvh, "joints": SMPL_JOINT_NAMES}, ("bones",)),
        BlenderImport("obj", {**single, "path": frame("obj")}, (*UPRIGHT, *normals)),
        BlenderImport("ply", {**single, "path": frame("ply")}, (*UPRIGHT, *normals, *sizes)),
    ]


def read_truth(folder: Path) -> Truth:
    """The prediction's first and last frame and some between them."""
    vertices_m, offsets_m = (np.load(folder / f"{name}.npy") for name in ("vertices", "offsets"))
    frames = np.linspace(0, len(vertices_m) - 1, TRIED).round().astype(int)
    moving = controlled_body(*Controls().load(None, None, Path(MOTION[1])), Controls())
    pose, trans_m = moving.pose[frames], moving.motion.trans_m[frames]
    _, joints_m = posed_joints(moving.body, moving.motion.betas, pose, trans_m)
    sizes_m = np.linalg.norm(offsets_m[frames], axis=-1)
    return Truth(frames, z_up(vertices_m[frames]), z_up(joints_m), sizes_m, len(vertices_m) - 1)


def z_up(places_m: NDArray) -> NDArray:
    """As Blender has them, from y up."""
    x, y, z = np.moveaxis(places_m, -1, 0)
    return np.stack([x, -z, y], axis=-1)


def works(python: str, way: BlenderImport, folder: Path, truth: Truth) -> bool:
    """Import in a process of its own, and say how far from the truth the body is."""
    frames = truth.frames
    if way.job.get("time_mode") == "TIME":
        frames = frames * (way.job["fps"] / FPS)
    frames = frames + way.job.get("begin", 0)
    job = {**way.job, "frames": frames.tolist(), "out": "seen.npz"}
    done = run([python, "-I", str(IMPORTER), json.dumps(job)], cwd=folder, timeout=COMMAND_S)
    if done.returncode:
        say(f"{way.name}: the import failed\n{done.stdout}{done.stderr}")
        return False
    with np.load(folder / "seen.npz") as seen:
        path = folder / way.job["path"]
        off_mm, wrong = judge(way.claims, bound_mm(path), without_copies(path, dict(seen)), truth)
    where = f"at frames {', '.join(map(str, truth.frames))} off by {off_mm:.4f} mm at most"
    say(f"{way.name}: {where}" + "".join(f"; FAILED: {what}" for what in wrong))
    return not wrong


def reads_what_it_writes(python: str, folder: Path, suffix: str) -> bool:
    """Have Blender write the exported BVH in another format, and say how far apart both are."""
    path = folder / f"WRITTEN{suffix}"
    job = {"how": "write", "path": "BODY.bvh", "fps": FPS, "out": [path.name]}
    done = run([python, "-I", str(IMPORTER), json.dumps(job)], cwd=folder, timeout=COMMAND_S)
    if done.returncode or not path.exists():
        say(f"writing {suffix}: failed\n{done.stdout}{done.stderr}")
        return False
    motion, other = load_motion(path), load_motion(folder / "BODY.bvh")
    if len(motion.theta) != len(other.theta):
        say(f"writing {suffix}: FAILED: {len(motion.theta)} frames, not {len(other.theta)}")
        return False
    one, two = (Rotation.from_rotvec(read.pose.reshape(-1, 3)) for read in (motion, other))
    off_deg = np.degrees((one.inv() * two).magnitude()).max()
    off_m = np.abs(motion.trans_m - other.trans_m).max()
    right = off_deg < MOST_DEG and off_m < MOST_M
    far = f"joints off by {off_deg:.4f} degrees, root by {1e3 * off_m:.4f} mm at most"
    say(f"{suffix} that it writes: {far}" + ("" if right else "; FAILED"))
    return bool(right)


def bound_mm(path: Path) -> float:
    """How far off a vertex may be: in a skeleton, as far as its file states, and a little more."""
    if path.suffix != ".glb":
        return BOUND_MM
    return gltf_of(path)["asset"]["extras"]["dsnet"]["largest_error_mm"] + MARGIN_MM


def without_copies(path: Path, seen: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """What was seen of the body's own vertices: in a glTF copies of those on seams of the picture
    follow, which must lie where these do."""
    if path.suffix != ".glb":
        return seen
    whole_m, vertex = seen["vertices_m"], body_vertices(path)
    np.testing.assert_allclose(whole_m, whole_m[:, vertex], atol=1e-6)
    by_vertex = {name: seen[name][:, : vertex.max() + 1] for name in ("vertices_m", "normals")}
    return seen | by_vertex | {"faces": vertex[seen["faces"]]}


def judge(
    claims: tuple[str, ...], most_mm: float, seen: dict[str, np.ndarray], truth: Truth
) -> tuple[float, list[str]]:
    """Largest distance of a vertex in mm, and what is not as it should be, of `claims` too."""
    places_m = truth.vertices_m if "faces" in seen else truth.joints_m
    off_mm = 1e3 * float(np.linalg.norm(seen["vertices_m"] - places_m, axis=-1).max())
    up_m = seen["vertices_m"][0, :, 2]
    nothing = np.array([np.nan])
    found = {
        "height_m": np.ptp(up_m),
        "lowest_m": up_m.min(),
        "normals_off_deg": normals_off_deg(seen, truth) if "faces" in seen else np.nan,
        "offset_m_off": np.abs(seen.get("offset_m", nothing) - truth.sizes_m).max(),
        "rate_after_import": seen.get("imported_fps", nothing)[0],
        "frames_off": np.abs(seen["range"] - [0, truth.last]).max(),
        "bones": seen["bones"].sum(),
    }
    wrong = [] if off_mm <= most_mm else [f"more than {most_mm:.4f} mm"]
    for claim in claims:
        least, most = ALLOWED[claim]
        if not least <= found[claim] <= most:
            wrong.append(f"{claim} is {found[claim]:.6g}; expected {least} to {most}")
    return off_mm, wrong


def normals_off_deg(seen: dict[str, np.ndarray], truth: Truth) -> float:
    """Largest angle between normals of vertices and those of the true surface."""
    faces = seen["faces"][0]
    normals = np.stack([vertex_normals(vertices_m, faces) for vertices_m in truth.vertices_m])
    cosines = np.einsum("fvx,fvx->fv", normals, seen["normals"])
    return np.degrees(np.arccos(cosines.clip(-1, 1))).max()


if __name__ == "__main__":
    sys.exit(main())
