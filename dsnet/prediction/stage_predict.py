"""`dsnet predict`: motions to the files of moving bodies; no framework unless it is asked for."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from itertools import chain, count
from pathlib import Path

from bridge.errors import DsnetError, did_you_mean, notify
from bridge.runs import Artifact
from bridge.runs.files import MANIFEST
from dsnet.prediction.controls import Controls
from dsnet.prediction.predict_folder import predict_folder
from dsnet.prediction.prediction_files import OF_MANY, OF_ONE, OFFSETS, WRITABLE, predict_motion
from dsnet.prediction.runtimes import Runtime


@dataclass(frozen=True)
class PredictConfig(Controls):
    """Predict how the skin of a body moves in a motion, or in all motions of a folder.

    Writes NumPy arrays at 60 fps, in metres, y up: offsets (frames, vertices, 3) in the rest pose,
    posed vertices of the same shape, and a picture.
    """

    run: str | None = None
    """Run whose predictor moves the skin, or a folder that `model.save` wrote; by default the small
    packaged model of the motion's gender."""
    predictor: str | None = None
    """Predictor of the run; by default its best, `dsnet_plus` if the run has it."""
    motion: Path | None = None
    """Motion file: AMASS `.npz`, BVH and others (docs/motion_files.md), or `sample:walking`. Or a
    folder: every motion below it that is not predicted yet."""
    out: Path | None = None
    """Folder to write: new, empty, or that of an earlier prediction. A folder of motions is written
    with the same subfolders."""
    write: tuple[str, ...] = ()
    """What to write, of offsets, vertices, latents and strip (a picture), or for offsets offsets16
    (float16) or nodes16 (of 500 nodes, 13 times smaller, for `dsnet.load_flesh`); by default all
    for one motion, and offsets for a folder."""
    runtime: Runtime = "onnx"
    """What predicts the latents of the paper's networks: `onnx`, ONNX Runtime frame by frame, or
    `keras`, the Keras model of whole motions. The manifest names it."""


PROFILES = {name: PredictConfig() for name in ("smoke", "demo", "paper")}


def main(config: PredictConfig) -> None:
    """Write the prediction, or those of a folder."""
    if config.motion is None:
        raise DsnetError(
            "predict without --motion",
            "one motion, or a folder of them",
            "Pass --motion FILE, or run `dsnet infer` for a run's sequences.",
        )
    if config.out is None:
        raise DsnetError("--motion without --out", "a folder to write", "Pass --out DIR.")
    write = what_to_write(config.write, config.motion)
    if config.person and config.motion.is_dir():
        remedy = "Predict that file alone, or leave --person out."
        raise DsnetError(f"--person with {config.motion}, a folder", "it with one motion", remedy)
    if config.motion.is_dir():
        predict_folder(
            config.run,
            config.motion,
            config.out,
            predictor=config.predictor,
            controls=config,
            write=write,
            runtime=config.runtime,
        )
        return
    earlier = (config.out / MANIFEST).exists()
    made = predict_motion(
        config.run,
        config.motion,
        config.out,
        predictor=config.predictor,
        controls=config,
        write=write,
        runtime=config.runtime,
    )
    notify(_what_was_made(made, config, ", in place of an earlier prediction" * earlier))


def _what_was_made(made: Artifact, config: PredictConfig, earlier: str) -> str:
    """What a prediction wrote, how far its skin moves, and the command that shows it."""
    manifest = made.manifest
    frames, fps = manifest["frames"], manifest["fps"]
    names = ", ".join(sorted(made.digests))
    look = f". To look at it: {shlex.join(_looking_at_it(config, made.path))}"
    look = "" if config.person else look  # no other command has that option
    strained = ""
    if (least := manifest.get("least_gain")) is not None:
        strained = f"; gains beyond 1 are lowered by strain, down to {least:g}"
    return (
        f"wrote {names} to {made.path}{earlier}: {frames} frames, {frames / fps:.1f} s at {fps:g} "
        f"fps; the skin moves by at most {manifest['largest_offset_mm']:.1f} mm{strained}{look}"
    )


def _looking_at_it(config: PredictConfig, made: Path) -> Iterator[str]:
    """The words of the command that writes the same moving body as a page beside the prediction."""
    made = made.resolve()
    others = (made.with_name(f"{made.name}-{number}.html") for number in count(2))
    pages = chain((made.with_name(f"{made.name}.html"),), others)
    page = next(path for path in pages if not path.exists())
    yield from ("dsnet", "export", "--to", "html", "--motion", str(config.motion))
    yield from ("--out", str(page))
    for field in fields(config):
        value = getattr(config, field.name)
        if field.name in ("motion", "out", "write", "runtime") or value == field.default:
            continue
        yield f"--{field.name.replace('_', '-')}"
        if value is not True:
            yield from value if isinstance(value, tuple) else (str(value),)


def what_to_write(write: Sequence[str], motion: Path) -> tuple[str, ...]:
    """The words of `--write`, each of `WRITABLE`, in that order; by default what is usual."""
    otherwise = OF_MANY if motion.is_dir() else OF_ONE
    words = [word for text in write for word in text.replace(",", " ").split()]
    if unknown := [word for word in words if word not in WRITABLE]:
        remedy = did_you_mean(unknown[0], WRITABLE, "Pass --write offsets,vertices.")
        raise DsnetError(f"--write {unknown[0]}", f"of {', '.join(WRITABLE)}", remedy)
    if len(forms := [word for word in OFFSETS if word in words]) > 1:
        raise DsnetError(f"--write {','.join(forms)}", "one of these", "Leave the others out.")
    if "strip" in words and not ("vertices" in words and {"offsets", "offsets16"} & {*words}):
        remedy = "Pass --write offsets,vertices,strip."
        raise DsnetError("--write strip", "it with offsets and vertices, which it shows", remedy)
    return tuple(word for word in WRITABLE if word in (words or otherwise))
