"""`python -m benchmarks.subspaces --out DIR --run RUN`: PCA, the paper's autoencoder, its peers.

Each code of each size is a file in DIR, made when it is finished; what is there is kept, and a
killed training goes on from DIR/.checkpoints. The cheap codes come first: seconds for PCA, then at
the default number of steps on one idle core two minutes for the residual autoencoder, six for each
of the paper's, twice that where a rate is searched for, and twenty minutes for Casas-Otaduy, which
needs 5.5 GB of memory besides the files that it reads, and 4.6 GB of disk.
"""

from __future__ import annotations

import json
import os
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from benchmarks.prediction.corpora import check_names
from benchmarks.subspaces.codes import CODES
from benchmarks.subspaces.data import SubspaceData
from benchmarks.subspaces.fitting import network_row, pca_row
from benchmarks.subspaces.page import draw, markdown
from benchmarks.subspaces.results import SUMMARY, refuse_others, row_name, rows_in
from benchmarks.subspaces.trainings import Budget, UntrainedCode, remove_all
from bridge.errors import DsnetError
from bridge.motion.splits import SplitName
from bridge.options import PositiveFloat, PositiveInt, Seed, check_options
from bridge.paper import LATENT_SIZE
from bridge.runs import Artifact, Run
from bridge.runs.files import exclusive, write_text_atomically
from bridge.runs.run import best_alignment
from bridge.runs.writer import provenance
from torch_align_ae.autoencoder.training import keep_freed_memory


@dataclass(frozen=True)
class SubspacesConfig:
    """Make what is missing, and tabulate all."""

    out: Path
    """Folder that receives a row a file, subspaces.json, .md and .png."""
    run: str = "demo"
    """Run whose aligned offsets are coded."""
    alignment: Literal["best", "align", "align_robust"] = "best"
    """Which alignment's: by default the robust aligner's."""
    codes: tuple[str, ...] = tuple(CODES)
    """Which codes."""
    sizes: tuple[PositiveInt, ...] = (25, 50, LATENT_SIZE)
    """Numbers kept of a mesh."""
    split: SplitName = "frame"
    """How validation frames are drawn, as in `dsnet train-ae`."""
    steps: PositiveInt = 345
    """Optimiser steps of each network."""
    search_steps: PositiveInt = 86
    """Steps of each rate that is tried."""
    rates: tuple[PositiveFloat, ...] = (1e-3, 3e-4, 1e-4, 3e-5)
    """Adam's rates that are tried where the rate is not the paper's."""
    batch_size: PositiveInt = 64
    """Frames a step; the paper's is 64."""
    validate_every: PositiveInt = 43
    """Steps between two validation losses, the best of which decides what is kept."""
    validation_frames: PositiveInt = 256
    """Validation frames scored each time; the table's errors are of all."""
    seed: Seed = 0
    """Decides the split, the weights' beginning and the order of frames."""

    def budget(self) -> Budget:
        """What every network is given."""
        return Budget(
            steps=self.steps,
            search_steps=self.search_steps,
            rates=self.rates,
            batch_size=self.batch_size,
            validate_every=self.validate_every,
            validation_frames=self.validation_frames,
        )


def main(config: SubspacesConfig) -> dict[str, Any]:
    """Write what is missing; returns what subspaces.json holds.

    Raises
    ------
    DsnetError
        If a code or a size is none, or the folder holds results of other data or settings.
    """
    _check(config)
    align = _alignment(config)
    settings = _settings(config, align)
    keep_freed_memory()
    with exclusive(config.out, str(config.out), "Wait until it has ended, or pass another --out."):
        refuse_others(config.out, settings)
        (config.out / ".checkpoints").mkdir(parents=True, exist_ok=True)
        data = SubspaceData.of(align, config.split, config.seed)
        results = _tabulated(config, settings)
        for size in dict.fromkeys(config.sizes):
            for name in dict.fromkeys(config.codes):
                if not (config.out / row_name(name, size, config.seed)).exists():
                    _make(config, settings, name, size, data)
                    results = _tabulated(config, settings)
        draw(config.out / "subspaces.png", config.out)
    return results


def _check(config: SubspacesConfig) -> None:
    check_options(config)
    check_names(config.codes, tuple(CODES), "codes")
    wrong = [size for size in config.sizes if size > LATENT_SIZE]
    if wrong or not config.sizes or not config.rates:
        raise DsnetError(
            f"--sizes {' '.join(map(str, config.sizes))} and {len(config.rates)} --rates",
            f"sizes from 1 to the paper's {LATENT_SIZE}, and at least one of each",
            "Pass --sizes N ... and --rates R ....",
        )


def _alignment(config: SubspacesConfig) -> Artifact:
    run = Run(config.run)
    return best_alignment(run) if config.alignment == "best" else run.artifact(config.alignment)


def _settings(config: SubspacesConfig, align: Artifact) -> dict[str, Any]:
    """All that the results of one folder have in common."""
    return {
        "run": config.run,
        "data": align.origin,
        "alignment": align.manifest["kind"],
        "aligner": align.manifest["config"].get("aligner"),
        "offsets": align.content_sha256,
        "split": config.split,
        "seed": config.seed,
        **asdict(config.budget()),
        "rates": list(config.rates),
    }


def _make(
    config: SubspacesConfig, settings: dict[str, Any], name: str, size: int, data: SubspaceData
) -> None:
    code, path = CODES[name], config.out / row_name(name, size, config.seed)
    checkpoint = config.out / ".checkpoints" / path.with_suffix(".safetensors").name
    started = time.perf_counter()
    if code.kind == "pca":
        row = pca_row(size, data, config.budget())
    else:
        row = network_row(UntrainedCode(code, size, data, config.budget(), checkpoint))
    found = {
        "code": name,
        "label": code.label,
        "size": size,
        **row,
        "settings": settings,
        "load": os.getloadavg()[0] if hasattr(os, "getloadavg") else None,  # none on Windows
        "provenance": provenance(time.perf_counter() - started),
    }
    write_text_atomically(path, json.dumps(found, indent=1, allow_nan=False) + "\n")
    remove_all(checkpoint)


def _tabulated(config: SubspacesConfig, settings: dict[str, Any]) -> dict[str, Any]:
    """Write the page of what is there so far."""
    results = {
        "settings": settings,
        "rows": rows_in(config.out, tuple(CODES)),
    }
    text = json.dumps(results, indent=1, allow_nan=False) + "\n"
    write_text_atomically(config.out / SUMMARY, text)
    write_text_atomically(config.out / "subspaces.md", markdown(config.out))
    return results
