"""What the paper says of how its network is trained, and what else than the two studies tells."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.claims.grounds import SAID
from benchmarks.claims.results import KNOWN, Results, mean_sd
from benchmarks.claims.row import BATCH_NORM, COMPARISON, DSNET, Claim, rule


def of_range(found: dict[str, Any]) -> Claim:
    words, outside = [], []
    for name, splits in found["networks"].items():
        shares = {split: layers["batch_norm"]["outside"] for split, layers in splits.items()}
        largest = max(layers["batch_norm"]["largest"] for layers in splits.values())
        outside += shares.values()
        words.append(
            f"{name.removeprefix('dsnet_')} {100 * shares['validation']:.0f} % on the held-out "
            f"jump, {100 * shares['train']:.0f} % on training clips, up to {largest:.1f}"
        )
    return Claim(
        "Batch normalisation keeps values within [-1, 1]",
        "5",
        "",
        rule(max(outside) < 0.01, max(outside) < 0.1),
        (BATCH_NORM,),
        f"outside of it are {'; '.join(words)}. The LSTM's own outputs are within by construction",
    )


def of_end_to_end(results: Results) -> Claim:
    r2 = {
        name: [one["cells"][KNOWN][name]["r2"] for one in results.comparison]
        for name in ("dsnet_searched", DSNET)
    }
    return Claim(
        "End-to-end training",
        "5",
        "the network alone or through a decoder: by the loss of the autoencoder's frozen latents "
        f"R² {mean_sd(r2['dsnet_searched'])} {SAID[KNOWN]}; by that of the vertices "
        f"{mean_sd(r2[DSNET])}, through the linear decoder of principal components, whose "
        "distances are those of vertices. Through the autoencoder's own decoder it was not tried",
        rule(False, np.mean(r2[DSNET]) - np.mean(r2["dsnet_searched"]) < 0.05),
        (COMPARISON,),
    )
