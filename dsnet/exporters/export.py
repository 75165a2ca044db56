"""`dsnet.export`: write a moving body, or a predictor, as a file for another tool."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

from bridge.errors import DsnetError
from dsnet.exporters.formats import FORMATS
from dsnet.exporters.onnx_model import Precision
from dsnet.exporters.stage_export import ExportConfig, export_as
from dsnet.prediction.controls import Controls
from dsnet.prediction.load_model import Source


def export(
    motion: Path | str | None,
    out: Path | str,
    to: str | None = None,
    model: Source = None,
    *,
    predictor: str | None = None,
    precision: Precision = "float32",
    skin: Literal["textured", "plain"] = "textured",
    **controls: Any,
) -> Path:
    """Write a body that performs a motion as a file for another tool: 60 fps, metres, y up.

    Parameters
    ----------
    motion : a motion file or `sample:NAME`; None for `onnx`, `onnx-clip`, `onnx-plain`, `keras`,
        `savedmodel` and `tflite`, which hold the predictor alone.
    out : a new file, or for `pc2`, `mdd`, `obj`, `ply` and `onnx-plain` a new folder.
    to : one of usd, pc2, mdd, obj, ply, glb, abc, bvh, npz, npz55, smpl, gif, mp4, html, onnx,
        onnx-clip, onnx-plain, keras, savedmodel, tflite; by the suffix of `out` when None.
    model : predictor that moves the skin, see `load_model`.
    precision : of the large kernels of an onnx graph.
    skin : `plain` leaves out the embedded bodies' picture of skin.
    controls : fields of `Controls`, as in `gain=1.5, part_gain=["belly=2"]`.

    Returns
    -------
    Path of what was written.

    Raises
    ------
    DsnetError
        If `out` exists, or the format, the motion or a control is not valid.
    """
    config = ExportConfig(
        to=to or format_of(Path(out)),
        motion=None if motion is None else Path(motion),
        out=Path(out),
        predictor=() if predictor is None else (predictor,),
        precision=precision,
        skin=skin,
        **vars(Controls.of(controls)),
    )
    export_as(config, model)
    return Path(out)


def format_of(out: Path) -> str:
    """The first format that has the suffix of `out`."""
    for name, entry in FORMATS.items():
        if out.suffix.lower() in entry.suffixes:
            return name
    endings = ", ".join(sorted({end for entry in FORMATS.values() for end in entry.suffixes}))
    raise DsnetError(f"{out} without a format", f"a name that ends in {endings}", "Pass to=.")
