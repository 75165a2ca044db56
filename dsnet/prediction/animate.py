"""Motions to moving bodies, in memory or as files: from Python."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from bridge.motion import Motion
from dsnet.prediction.controls import Controls, controlled_body
from dsnet.prediction.load_model import Source
from dsnet.prediction.moving_body import MovingBody
from dsnet.prediction.predict_folder import predict_folder
from dsnet.prediction.prediction_files import predict_motion
from dsnet.prediction.stage_predict import what_to_write


def animate(
    motion: Motion | Path | str,
    model: Source = None,
    *,
    predictor: str | None = None,
    **controls: Any,
) -> MovingBody:
    """A body that performs a motion, with the dynamics of its skin.

    `.arrays()` gives vertices and offsets of all frames (T, V, 3), metres, at 60 fps with y up;
    iterating gives the same in pieces of 64 frames, so that memory does not grow with the motion.

    Parameters
    ----------
    motion : what `load_motion` gives, or a file that it reads, or `sample:NAME`.
    model : what `load_model` gives or takes: None for the package's of the motion's gender,
        `"female"`, `"male"`, a run's name, a folder that `TrainedModel.save` wrote.
    predictor : which of a run's; its best when None.
    controls : fields of `Controls`, as in `gain=1.5, floor="shift", shape={"height": 182}`.

    Raises
    ------
    DsnetError
        If the motion, the model or something requested does not exist or does not go together.
    """
    options = Controls.of(controls)
    if isinstance(motion, Motion):
        trained = options.model(model, predictor, motion)
    else:
        options.check()
        trained, motion = options.load(model, predictor, Path(motion))
    return controlled_body(trained, motion, options)


def predict(
    motion: Path | str,
    out: Path | str,
    model: Source = None,
    *,
    predictor: str | None = None,
    write: Sequence[str] = (),
    **controls: Any,
) -> Path:
    """Write the moving body of one motion, or of every motion below a folder, to files.

    Parameters
    ----------
    motion : a motion file, `sample:NAME`, or a folder.
    out : folder to write: of one motion `offsets.npy`, `vertices.npy` (T, V, 3), metres,
        `strip.png` and `manifest.json`; of a folder the same tree, with the offsets alone.
    model, predictor, controls : as for `animate`.
    write : which of offsets, offsets16 (float16) or nodes16 (of nodes), vertices, latents, strip;
        the above when empty. `load_flesh` reads all three forms of offsets.

    Returns
    -------
    Path of `out`.

    Raises
    ------
    DsnetError
        As for `animate`; if `out` holds anything else; if some file of a folder was refused.
    """
    motion, out, options = Path(motion), Path(out), Controls.of(controls)
    words, of_many = what_to_write(write, motion), motion.is_dir()
    run = predict_folder if of_many else predict_motion
    run(model, motion, out, predictor=predictor, controls=options, write=words)
    return out
