"""`dsnet export`: write a moving body for Blender, Maya, Houdini, Unreal and others."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from bridge.errors import DsnetError, notify
from dsnet.exporters.formats import FORMATS, Format, chosen_format
from dsnet.exporters.keras_files import keras_file
from dsnet.exporters.output import new_path, refuse_existing
from dsnet.prediction.controls import Controls, controlled_body
from dsnet.prediction.load_model import Source, name_of
from dsnet.prediction.moving_body import MovingBody


@dataclass(frozen=True, kw_only=True)
class ExportConfig(Controls):
    """Write a moving body as a file for another tool: 60 fps, metres, y up."""

    to: str | None = None
    """Format: usd, pc2, mdd, obj, ply, glb, abc, bvh, npz, npz55, smpl, gif, mp4 or html of a
    motion. Or of a predictor alone: onnx, with its body as one graph; onnx-clip, the same of
    whole clips; onnx-plain, in a folder without control flow; keras, savedmodel or tflite, a
    network that Keras trained. docs/export.md says how to open each."""
    motion: Path | None = None
    """Motion file: AMASS `.npz`, BVH and others (docs/motion_files.md), or `sample:walking`; for
    formats that show one."""
    run: str | None = None
    """Run whose predictor moves the skin, or a folder that `model.save` wrote; by default the small
    packaged model of the motion's gender."""
    predictor: tuple[str, ...] = ()
    """Predictors of the run; by default its best. Formats gif, mp4 and html show several."""
    precision: Literal["float32", "float16", "int8"] = "float32"
    """Precision of the large weights of an onnx graph; the file states the error of fewer bits."""
    skin: Literal["textured", "plain"] = "textured"
    """`plain`: without the embedded bodies' picture of skin, hair and sportswear."""
    out: Path | None = None
    """File to write, or a folder for pc2, mdd, obj, ply and onnx-plain; it must not exist."""


PROFILES = dict.fromkeys(("smoke", "demo", "paper"), ExportConfig())


def main(config: ExportConfig) -> None:
    export_as(config, config.run)
    if out := config.out:
        files = [path for path in (out, *out.rglob("*")) if path.is_file()]
        size_mb = sum(path.stat().st_size for path in files) / 1e6
        notify(f"wrote {out}: {size_mb:.1f} MB")


def export_as(config: ExportConfig, source: Source) -> None:
    """Write the export that `config` describes, with a predictor that `load_model` finds."""
    to, out = config.to, config.out
    if to is None:
        raise DsnetError("export without --to", f"one of {', '.join(FORMATS)}", "Pass --to FORMAT.")
    if out is None:
        raise DsnetError("export without --out", "a path to write", "Pass --out PATH.")
    chosen = chosen_format(to, out)
    config.check()
    if to != "onnx" and config.precision != "float32":
        raise DsnetError(
            f"--to {to} with --precision {config.precision}",
            "float32: fewer bits are for --to onnx",
            "Leave out --precision.",
        )
    if len(config.predictor) > 1 and not chosen.several:
        clips = " or ".join(name for name, other in FORMATS.items() if other.several)
        raise DsnetError(
            f"--to {to} with {len(config.predictor)} predictors",
            f"one predictor, or --to {clips}",
            "Export them one by one.",
        )
    refuse_existing(out)
    if not chosen.needs_motion:
        _export_predictor(config, source, chosen, out)
        return
    moving = _moving_bodies(config, source)
    with new_path(out) as path:
        for one in moving:
            one.plain = config.skin == "plain"
            one.announce()
        if chosen.is_folder:
            path.mkdir()
        chosen.writer()(path, *moving)


def _export_predictor(config: ExportConfig, source: Source, chosen: Format, out: Path) -> None:
    if config.motion is not None or config.given().keys() - {"gender"}:
        raise DsnetError(
            f"--to {config.to} with a motion or its controls",
            "a predictor alone: the graph takes any motion and shape",
            "Leave out --motion, --gain, --betas and the like.",
        )
    trained = config.model(source, next(iter(config.predictor), None))
    notify(f"{trained.name} ({trained.label}) of {trained.owner}: {trained.why}")
    if chosen.of_keras:
        network = keras_file(trained)
        with new_path(out) as path:
            chosen.writer()(path, network)
        return
    fewer_bits = {"precision": config.precision} if config.to == "onnx" else {}
    with new_path(out) as path:
        chosen.writer()(path, trained, run=name_of(source) or "packaged", **fewer_bits)


def _moving_bodies(config: ExportConfig, source: Source) -> list[MovingBody]:
    """The body in its motion, by each of the chosen predictors."""
    if config.motion is None:
        raise DsnetError("export without --motion", "one AMASS file", "Pass --motion FILE.")
    opened = [config.load(source, name, config.motion) for name in config.predictor or (None,)]
    return [controlled_body(trained, motion, config) for trained, motion in opened]
