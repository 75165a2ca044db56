"""The formats of `dsnet export --to`: one entry each, which names the function that writes it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

from bridge.errors import DsnetError, unknown_name
from bridge.installation import require_package


@dataclass(frozen=True)
class Format:
    """One way to write a moving body."""

    writer_name: str
    """Module and function `write(path, moving)`, which writes a `MovingBody` to a new file, or into
    an empty folder, with few frames in memory at a time."""
    suffixes: tuple[str, ...] = ()
    """Suffixes of its file; none if it is a folder of files."""
    package: str | None = None
    """Module that must be importable, besides those of the installation without extras."""
    extra: str | None = None
    """The extra that installs this module."""
    several: bool = False
    """Whether its writer takes several moving bodies: one motion by several predictors."""
    needs_motion: bool = True
    """Whether it shows a motion; otherwise it holds a predictor, for any motion."""
    title: str = ""
    """What it is, to one who chooses; empty: its name says so."""
    of_keras: bool = False
    """Whether it is made from the `.keras` file of a run's network, by `write(path, file)`."""

    @property
    def is_folder(self) -> bool:
        """Whether it is a folder of files."""
        return not self.suffixes

    def writer(self) -> Callable[..., None]:
        """Import its module and give its function."""
        module, _, name = self.writer_name.rpartition(".")
        return getattr(import_module(module), name)


def _by_keras(function: str, *suffixes: str) -> Format:
    writer = f"tf_dsnet.keras_files.{function}"
    return Format(writer, suffixes, "tensorflow", "train", needs_motion=False, of_keras=True)


FORMATS = {
    "onnx": Format("dsnet.exporters.onnx_model.export_onnx", (".onnx",), needs_motion=False),
    "onnx-clip": Format(
        "dsnet.exporters.onnx_model.export_onnx_clip", (".onnx",), needs_motion=False
    ),
    "onnx-plain": Format("dsnet.exporters.onnx_model.export_onnx_plain", needs_motion=False),
    "usd": Format(
        "dsnet.exporters.usd.write",
        (".usdz", ".usd", ".usdc", ".usda"),
        "pxr",
        "usd",
        title="USD: Houdini, Blender, Maya, Unreal",
    ),
    "pc2": Format("dsnet.exporters.mesh_files.write_pc2", title="point cache PC2, with its mesh"),
    "mdd": Format("dsnet.exporters.mesh_files.write_mdd", title="point cache MDD, with its mesh"),
    "obj": Format("dsnet.exporters.mesh_files.write_obj", title="OBJ, one a frame"),
    "ply": Format("dsnet.exporters.mesh_files.write_ply", title="PLY, one a frame"),
    "glb": Format(
        "dsnet.exporters.glb.write", (".glb",), title="glTF: Blender, Unreal, Unity, the web"
    ),
    "abc": Format(
        "dsnet.exporters.alembic.write",
        (".abc",),
        "alembic3d",
        "abc",
        title="Alembic: every point of every frame",
    ),
    "bvh": Format("dsnet.exporters.bvh.write", (".bvh",), title="BVH: joints alone"),
    "npz": Format(
        "dsnet.exporters.smpl_npz.write", (".npz",), title="NPZ: SMPL's parameters and the offsets"
    ),
    "npz55": Format(
        "dsnet.exporters.smpl_npz.write_smplx", (".npz",), title="NPZ of SMPL-X's 55 joints"
    ),
    "smpl": Format(
        "dsnet.exporters.smpl_npz.write_smpl", (".smpl",), title="SMPL's parameters for Meshcapade"
    ),
    "gif": Format(
        "dsnet.exporters.clips.write_gif", (".gif",), several=True, title="GIF, an animated picture"
    ),
    "mp4": Format(
        "dsnet.exporters.clips.write_mp4",
        (".mp4",),
        "imageio_ffmpeg",
        "clip",
        several=True,
        title="MP4, a clip",
    ),
    "html": Format(
        "dsnet.view.page.write", (".html",), several=True, title="this page as one file"
    ),
    "keras": Format(
        "dsnet.exporters.keras_files.write_keras", (".keras",), needs_motion=False, of_keras=True
    ),
    "savedmodel": _by_keras("write_savedmodel"),
    "tflite": _by_keras("write_tflite", ".tflite"),
}


def chosen_format(name: str, out: Path) -> Format:
    """The format `name`; `DsnetError` if a package is missing or the suffix of `out` is another."""
    if name not in FORMATS:
        blender = "Pass --to glb or usd, and convert it in Blender."
        remedy = {"fbx": blender, "gltf": "Pass --to glb."}.get(name.lower(), "Pass one of these.")
        raise unknown_name(f"--to {name}", name, FORMATS, remedy)
    chosen = FORMATS[name]
    if chosen.package and chosen.extra:
        require_package(chosen.package, chosen.extra, f"--to {name}")
    if chosen.suffixes and out.suffix.lower() not in chosen.suffixes:
        raise DsnetError(
            f"--out {out} with --to {name}",
            f"a file whose name ends in {' or '.join(chosen.suffixes)}",
            f"Pass --out {out.with_suffix(chosen.suffixes[0])}.",
        )
    return chosen
