"""Install the extension in Blender, press its button, and compare with what `dsnet` predicts.

Part of `python -m tools.try_blender`, which installs Blender: an armature that Blender reads from a
BVH gets a body, a mesh of a GLB shape keys; each is looked at with three gains, in a file that is
opened again, and after a bake that begins later.
"""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import dsnet
from dsnet.blender.flesh import z_up
from tools.build_blender_extension import build
from tools.built_wheel import ROOT
from tools.try_pythons import last_line, run, say

SCRIPT = ROOT / "tools" / "blender_soft_tissue.py"
MOTION, FRAMES, LATER = "sample:walking", (0, 30, 61, 150, 239), 20
"""The frames that are compared, and by how many a second bake begins later."""
BOUND_MM = 0.1
TRY_S = 600
REFUSED = ("nothing selected", "soft tissue of dsnet export")
_AFTER = 3
"""The first of `FRAMES` that a later bake has settled before."""


def extension_works(python: str, folder: Path) -> bool:
    """Whether it does what it says in this Blender; not, and a line, where it cannot be tried."""
    try:
        extension = build(folder / "soft_tissue.zip", ["linux-x64"], "3.11")
    except OSError as error:
        say(f"extension: not tried: {error}")
        return True
    files = {name: folder / f"{name}.glb" for name in ("glb", "with_flesh")}
    files["bvh"] = folder / "extension.bvh"
    dsnet.export(MOTION, files["glb"], gain=0.0, shape="heavy")
    dsnet.export(MOTION, files["with_flesh"])
    dsnet.export(MOTION, files["bvh"])
    scratch, out = folder / "scratch", folder / "extension.npz"
    scratch.mkdir()
    job = {name: str(path) for name, path in files.items()}
    job |= {"extension": str(extension), "scratch": str(scratch), "out": str(out)}
    words = json.dumps({**job, "frames": FRAMES, "later": LATER})
    done = run([python, "-I", str(SCRIPT), words], cwd=folder, timeout=TRY_S)
    if not out.exists():
        say(f"extension: failed, {last_line(done)}\n{done.stdout}{done.stderr}")
        return False
    with np.load(out) as seen:
        off_mm, wrong = judge(dict(seen), truth_of(files))
    megabytes = extension.stat().st_size / 1e6
    far = ", ".join(f"{name} {off:.4f} mm" for name, off in off_mm.items())
    say(f"extension of {megabytes:.0f} MB: off by {far}" + "".join(f"; FAILED: {w}" for w in wrong))
    return not wrong


def truth_of(files: dict[str, Path]) -> dict[str, NDArray[np.float32]]:
    """By name and gain, (N, V, 3) what `dsnet` has of the same files at `FRAMES`, z up; of a bake
    that begins later, of the frames from there on."""
    found = {}
    for name in ("bvh", "glb"):
        motion = dsnet.load_motion(files[name])
        controls = {"shape": "heavy"} if name == "glb" else {}
        vertex = body_vertices(files[name]) if name == "glb" else slice(None)
        for gain in (0.0, 1.0):
            vertices_m, _ = dsnet.animate(motion, gain=gain, **controls).arrays()
            found[f"{name} {gain:g}"] = z_up(vertices_m[[*FRAMES]][:, vertex])
        # The panel's gain multiplies; that of `animate` is limited by strain.
        found[f"{name} 2"] = 2 * found[f"{name} 1"] - found[f"{name} 0"]
        later = motion.frames(slice(LATER, None))
        vertices_m, _ = dsnet.animate(later, **controls).arrays()
        frames = [frame - LATER for frame in FRAMES[_AFTER:]]
        found[f"{name} later"] = z_up(vertices_m[frames][:, vertex])
    return found


def body_vertices(path: Path) -> NDArray[np.int64]:
    """(N,) which of the body's vertices each of a GLB's is: copies of those on seams of the picture
    of skin follow the body's own."""
    gltf = gltf_of(path)
    mesh = gltf["meshes"][0]
    count = gltf["accessors"][mesh["primitives"][0]["attributes"]["POSITION"]]["count"]
    copies = mesh["extras"]["dsnet"].get("copies_of", [])
    return np.array([*range(count - len(copies)), *copies])


def gltf_of(path: Path) -> dict[str, Any]:
    """The JSON of a GLB file."""
    with path.open("rb") as file:
        (length,) = struct.unpack("<12xI4x", file.read(20))
        return json.loads(file.read(length))


def judge(
    seen: dict[str, NDArray], truth: dict[str, NDArray]
) -> tuple[dict[str, float], list[str]]:
    """How far off what the button made is, in mm, and what is not as it should be.

    A body stands where `dsnet` has it. A mesh is posed by Blender, in the place of its armature:
    of it the flesh is compared, what a gain adds to none.
    """
    off_mm = {}
    for name in ("bvh", "glb"):
        alone = (seen[f"{name} 0"], truth[f"{name} 0"]) if name == "glb" else (0.0, 0.0)
        for gain in (0, 1, 2):
            key = f"{name} {gain}"
            off_mm[key] = _apart_mm(seen[key] - alone[0], truth[key] - alone[1])
        off_mm[f"{name} reopened"] = _apart_mm(seen[f"{name} reopened"], seen[f"{name} 1"])
        moved, moved_most = (seen[f"{name} {gain}"] - seen[f"{name} 0"] for gain in (1, 2))
        off_mm[f"{name} doubled"] = _apart_mm(moved_most, 2 * moved)
        later = seen[f"{name} later"][_AFTER:]
        if name == "glb":
            later = later - seen["glb 0"][_AFTER:]
            truth_later = truth["glb later"] - truth["glb 0"][_AFTER:]
        else:
            truth_later = truth["bvh later"]
        off_mm[f"{name} later"] = _apart_mm(later, truth_later)
    off_mm["glb before"] = _apart_mm(seen["glb before"], seen["glb 0"])
    bounds = {name: 2 * BOUND_MM if name.endswith(" 2") else BOUND_MM for name in off_mm}
    wrong = [f"{name} by more than {bounds[name]} mm" for name, off in off_mm.items()
             if not off <= bounds[name]]  # fmt: skip
    wrong += [f"a second bake adds objects ({name})" for name in ("bvh", "glb")
              if seen[f"{name} more objects"]]  # fmt: skip
    for said, expected in zip(seen["refused"], REFUSED, strict=True):
        if expected not in str(said):
            wrong.append(f"it says {said!r}, not {expected!r}")
    return off_mm, wrong


def _apart_mm(one: NDArray, other: NDArray) -> float:
    return 1e3 * float(np.linalg.norm(one - other, axis=-1).max())
