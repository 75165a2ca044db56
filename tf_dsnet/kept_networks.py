"""Networks that a run has trained before: they stay, as they are, where another one is added."""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from bridge.errors import DsnetError, notify
from bridge.exchange.train_options import NetworksRecord
from bridge.runs import Artifact, ArtifactWriter, Run, read_artifact
from bridge.runs.run import TRAIN
from tf_dsnet.predictors import DsnetPredictor, Predictor

_ARRAYS = ("loss", "validation_loss", "validation_epochs")
"""Of each network, `<array>_<network>`, beside its weights."""


@dataclass(frozen=True)
class NetworksPlan:
    """Which networks a training makes, which it keeps, and what the artifact records of both."""

    new: tuple[Predictor, ...]
    kept: tuple[str, ...]
    config: Mapping[str, Any]
    earlier: Artifact | None

    @property
    def names(self) -> tuple[str, ...]:
        """All networks in their order; the first one is the default."""
        return tuple(self.config["predictors"])

    def copy_kept(self, run: Run, writer: ArtifactWriter) -> dict[str, Any]:
        """Write the kept networks into the new artifact; gives their entries of the manifest.

        Raises `DsnetError` where another process has trained since the plan was made, or a file is
        damaged.
        """
        if self.earlier is None or not self.kept:
            return {}
        if read_artifact(run.path / TRAIN).content_sha256 != self.earlier.content_sha256:
            received = f"stage {TRAIN!r} of run {run.name!r}, which another process has made anew"
            raise DsnetError(received, "one training at a time", "Run the same command again.")
        for name in self.kept:
            for file in self.earlier.manifest["files"]:
                if Path(file).stem == name:
                    shutil.copyfile(self.earlier.file(file), writer.file_path(file))
            for array in (f"{kind}_{name}" for kind in _ARRAYS):
                unit = self.earlier.manifest["arrays"][array]["unit"]
                writer.put(array, self.earlier.array(array), unit)
        return {name: self.earlier.manifest["predictors"][name] for name in self.kept}


def plan_networks(
    run: Run, encoded: Artifact, config: NetworksRecord, chosen: Sequence[Predictor]
) -> NetworksPlan:
    """Train `chosen`, keep what was trained on the same latents.

    A chosen network that was trained with the same settings and layers is kept as well. Added
    networks come last, so that the default stays; who names all of them gives their order.
    """
    earlier = _trained_on(run, encoded, {entry.name for entry in chosen})
    before = earlier.manifest["config"]["predictors"] if earlier else {}
    settings = {entry.name: _settings_of(config, entry) for entry in chosen}
    new = [entry for entry in chosen if before.get(entry.name) != settings[entry.name]]
    names = [*settings]
    if not set(names) >= set(before):
        names = [*before, *(name for name in names if name not in before)]
    kept = tuple(name for name in names if name not in {entry.name for entry in new})
    if kept and new:
        notify(f"kept as trained before: {', '.join(kept)}")
    of_each = {name: (before | settings)[name] for name in names}
    return NetworksPlan(tuple(new), kept, {"default": names[0], "predictors": of_each}, earlier)


def _trained_on(run: Run, encoded: Artifact, chosen: set[str]) -> Artifact | None:
    """The finished `train` of these latents, if all that it holds can be kept; a note names the
    networks that go without being trained again."""
    try:
        earlier = read_artifact(run.path / TRAIN)
    except DsnetError:  # none, or damaged and about to be made again
        return None
    networks = earlier.manifest["predictors"]
    needed = {f"{kind}_{name}" for kind in _ARRAYS for name in networks}
    is_of_these = earlier.manifest["upstream"] == {"encode": encoded.content_sha256}
    if is_of_these and needed <= set(earlier.manifest["arrays"]):
        return earlier
    if gone := sorted({*networks} - chosen):
        reason = "by an earlier version of dsnet" if is_of_these else "on other latents"
        notify(f"not kept, as trained {reason}: {', '.join(gone)}")
    return None


def _settings_of(config: NetworksRecord, entry: Predictor) -> dict[str, Any]:
    """What decides the weights of a network, as a manifest holds it."""
    settings = json.loads(json.dumps(asdict(config)))
    del settings["predictors"]
    if config.lstm == NetworksRecord.lstm:  # as before there was a choice
        del settings["lstm"]
    network = entry.network_sha256(config) if isinstance(entry, DsnetPredictor) else ""
    return {**settings, **({"network": network} if network else {})}
