"""What was carried over to a body, kept by the body's digest: safe to delete, never needed."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from bridge import __version__
from bridge.body import BodyModelData
from bridge.errors import DsnetError
from bridge.exchange.weights import load_checkpoint, save_checkpoint
from bridge.runs.files import arrays_sha256, json_sha256
from bridge.tissue.trained_plus import TrainedPlus
from dsnet.prediction.transfer import carried

_METHOD = 1
"""Goes up when `carried` gives something else."""


def cache_folder() -> Path:
    """The user's: `dsnet` in `XDG_CACHE_HOME`, or where the system keeps such things."""
    usual = {"darwin": "~/Library/Caches", "win32": "~/AppData/Local"}.get(sys.platform, "~/.cache")
    return Path(os.environ.get("XDG_CACHE_HOME") or usual).expanduser() / "dsnet"


def body_digest(body: BodyModelData) -> str:
    """SHA-256 of a body's surface, shapes and skeleton, whatever it is called."""
    regressor = body.J_regressor.sorted_indices()
    names = ("v_template", "shapedirs", "weights", "faces", "parents")
    return arrays_sha256({name: getattr(body, name) for name in names} | {
        "J_data": regressor.data, "J_indices": regressor.indices, "J_indptr": regressor.indptr,
    })  # fmt: skip


def carried_over(
    model: TrainedPlus, made_of: str, trained_on: Callable[[], BodyModelData], body: BodyModelData
) -> TrainedPlus:
    """The model on a body; itself, where that is the one that it was trained on.

    Parameters
    ----------
    made_of : digest of the model and whatever it was made of.
    trained_on : gives the body that it was trained on, called only if nothing is kept.
    """
    digest = body_digest(body)
    name = json_sha256([_METHOD, __version__, made_of, digest])
    kept = cache_folder() / f"{name}.safetensors"
    with suppress(OSError, DsnetError):  # a cache that cannot be read is none
        if (arrays := load_checkpoint(kept)) is not None:
            model = TrainedPlus.from_arrays(arrays)
            sizes = model.beta_count, len(model.nodes.owners)
            if model.elsewhere and sizes == (body.shapedirs.shape[-1], body.vertex_count):
                return model
    home = trained_on()
    if body_digest(home) == digest:
        return model
    made = carried(model, home, body)
    with suppress(OSError):
        kept.parent.mkdir(parents=True, exist_ok=True)
        partial = kept.with_name(f"{name}.{os.getpid()}.safetensors")
        save_checkpoint(partial, made.arrays())
        os.replace(partial, kept)
    return made
