"""What `dsnet export --to` can write: one entry a format, which names the function that does it."""

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
    an empty folder, and holds some frames at a time."""
    suffixes: tuple[str, ...] = ()
    """What the name of its one file may end in; none if it is a folder of files."""
    package: str | None = None
    """What it needs beyond the installation without extras, as it is imported."""
    extra: str | None = None
    """The extra that brings it."""
    several: bool = False
    """Whether its writer takes several moving bodies, of one body and motion."""
    of_motion: bool = True
    """Whether it shows a motion; else it holds a predictor and its body, for motions to come."""

    @property
    def is_folder(self) -> bool:
        """Whether it is a folder of files."""
        return not self.suffixes

    def writer(self) -> Callable[..., None]:
        """Its function, whose module is imported now."""
        module, _, name = self.writer_name.rpartition(".")
        return getattr(import_module(module), name)


FORMATS = {
    "onnx": Format("dsnet.exporters.onnx_model.export_onnx", (".onnx",), of_motion=False),
    "usd": Format("dsnet.exporters.usd.write", (".usd", ".usdc", ".usda"), "pxr", "usd"),
    "pc2": Format("dsnet.exporters.mesh_files.write_pc2"),
    "mdd": Format("dsnet.exporters.mesh_files.write_mdd"),
    "obj": Format("dsnet.exporters.mesh_files.write_obj"),
    "ply": Format("dsnet.exporters.mesh_files.write_ply"),
    "glb": Format("dsnet.exporters.glb.write", (".glb",)),
    "abc": Format("dsnet.exporters.alembic.write", (".abc",), "alembic3d", "abc"),
    "bvh": Format("dsnet.exporters.bvh.write", (".bvh",)),
    "npz": Format("dsnet.exporters.smpl_npz.write", (".npz",)),
    "npz55": Format("dsnet.exporters.smpl_npz.write_smplx", (".npz",)),
    "smpl": Format("dsnet.exporters.smpl_npz.write_smpl", (".smpl",)),
    "gif": Format("dsnet.exporters.clips.write_gif", (".gif",), several=True),
    "mp4": Format(
        "dsnet.exporters.clips.write_mp4", (".mp4",), "imageio_ffmpeg", "clip", several=True
    ),
    "html": Format("dsnet.view.page.write", (".html",), several=True),
}


def chosen_format(name: str, out: Path) -> Format:
    """The format `name`, if it can be written here to a path like `out`."""
    if name not in FORMATS:
        blender = "Take --to glb or usd, and convert it in Blender."
        remedy = blender if name.lower() == "fbx" else "Pass one of these."
        raise unknown_name(f"--to {name}", name, FORMATS, remedy)
    form = FORMATS[name]
    if form.package and form.extra:
        require_package(form.package, form.extra, f"--to {name}")
    if form.suffixes and out.suffix.lower() not in form.suffixes:
        raise DsnetError(
            f"--out {out} with --to {name}",
            f"a file whose name ends in {' or '.join(form.suffixes)}",
            f"Pass --out {out.with_suffix(form.suffixes[0])}.",
        )
    return form
