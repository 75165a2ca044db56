"""What `dsnet export --to` can write: one entry a format, which names the module that does it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

from bridge.errors import DsnetError, did_you_mean
from bridge.installation import require_package

Writer = Callable[..., None]
"""`write(path, moving)`: writes a `MovingBody` to a new file, or into an empty folder; holds some
frames at a time. One that shows several takes more of them, of one body and motion."""


@dataclass(frozen=True)
class Format:
    """One way to write a moving body."""

    module: str
    """Which holds its `write`, a `Writer`."""
    suffixes: tuple[str, ...] = ()
    """What the name of its one file may end in; none if it is a folder of files."""
    package: str | None = None
    """What it needs beyond the installation without extras, as it is imported."""
    extra: str | None = None
    """The extra that brings it."""
    several: bool = False
    """Whether it can show what several predictors make of one motion."""
    of_motion: bool = True
    """Whether it shows a motion; else it holds a predictor and its body, for motions to come."""

    @property
    def is_folder(self) -> bool:
        """Whether it is a folder of files."""
        return not self.suffixes

    def writer(self) -> Writer:
        """Its `write`, whose module is imported now."""
        return import_module(self.module).write


FORMATS = {
    "onnx": Format("bridge.export.onnx_model", (".onnx",), of_motion=False),
    "usd": Format("bridge.export.usd", (".usd", ".usdc", ".usda"), "pxr", "usd"),
    "pc2": Format("bridge.export.pc2"),
    "mdd": Format("bridge.export.mdd"),
    "obj": Format("bridge.export.obj"),
    "ply": Format("bridge.export.ply"),
    "npz": Format("bridge.export.smpl_npz", (".npz",)),
    "gif": Format("bridge.export.gif", (".gif",), several=True),
    "mp4": Format("bridge.export.mp4", (".mp4",), "imageio_ffmpeg", "clip", several=True),
}


def chosen_format(name: str, out: Path) -> Format:
    """The format `name`, which can be written here to a path like `out`.

    Raises
    ------
    DsnetError
        If there is no such format, its extra is not installed, or `out` has another suffix.
    """
    if name not in FORMATS:
        known = ", ".join(FORMATS)
        remedy = did_you_mean(name, FORMATS, "Pass one of these.")
        raise DsnetError(f"--to {name}", f"one of {known}", remedy)
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
