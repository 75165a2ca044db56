"""A moving body, or a predictor, as a file for another tool: from Python."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from bridge.errors import DsnetError
from dsnet.exporters.formats import FORMATS
from dsnet.exporters.onnx_model import Precision
from dsnet.exporters.stage_export import ExportConfig, export_as
from dsnet.prediction.load_model import Source


def export(
    motion: Path | str | None,
    out: Path | str,
    to: str | None = None,
    model: Source = None,
    *,
    predictor: str | None = None,
    precision: Precision = "float32",
    **controls: Any,
) -> Path:
    """Write a body that performs a motion as a file for another tool: 60 fps, metres, y up.

    Parameters
    ----------
    motion : a motion file or `sample:NAME`; None for `onnx`, which holds the predictor itself.
    out : a new file, or for `pc2`, `mdd`, `obj` and `ply` a new folder.
    to : one of usd, pc2, mdd, obj, ply, glb, abc, bvh, npz, npz55, smpl, gif, mp4, html, onnx; what
        the name of `out` ends in when left out.
    model : whose predictor moves the skin: see `load_model`.
    precision : of the large kernels of an onnx graph.
    controls : fields of `Controls`, as in `gain=1.5, part_gain=["belly=2"]`.

    Returns
    -------
    Path of what was written.

    Raises
    ------
    DsnetError
        If `out` exists, or the format, the motion or what is asked for does not.
    """
    config = ExportConfig(
        to=to or format_of(Path(out)),
        motion=None if motion is None else Path(motion),
        out=Path(out),
        predictor=() if predictor is None else (predictor,),
        precision=precision,
        **controls,
    )
    export_as(config, model)
    return Path(out)


def format_of(out: Path) -> str:
    """The first format whose files end as `out` does."""
    for name, form in FORMATS.items():
        if out.suffix.lower() in form.suffixes:
            return name
    endings = ", ".join(sorted({end for form in FORMATS.values() for end in form.suffixes}))
    raise DsnetError(f"{out} without a format", f"a name that ends in {endings}", "Pass to=.")
