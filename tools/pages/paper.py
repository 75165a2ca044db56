"""docs/results/departures.md and alignment/readings.md: changes to the paper, and readings."""

from __future__ import annotations

from typing import Any

from tools.pages.blocks import load, table

_HEAD = (
    "from the paper's words to this repository | steps of the autoencoder | its R² | "
    "epochs of DSNet | "
    "R², held-out clip | mean error, mm | R², new people, known motions"
)


def departures() -> str:
    """docs/results/departures.md, from `departures.json` beside it."""
    results = load("departures")
    return (
        "# From the paper's words to this repository\n\nEach row makes one more change to the "
        "paper's pipeline ([what it is](../paper.md#the-papers-words-alone)) and trains again.\n\n"
        f"{table(_HEAD, map(_row, results['rows']))}\n"
        "R² is 1 for a perfect code or prediction and 0 for SMPL alone; of predictions it is of "
        f"the posed mesh. Synthetic data, run `{results['run']}`, seed 0 ({results['machine']}). "
        "Made by `python -m benchmarks.departures --run demo --out docs/results/departures.json`.\n"
    )


def _row(row: dict[str, Any]) -> tuple[str, ...]:
    clip, new = row["cells"]["validation"], row["cells"]["new_person_known_motion"]
    plus = row["predictor"] == "dsnet_plus"
    trained = f"{row['autoencoder_steps']:,}", f"{row['autoencoder_r2']:.2f}", f"{row['epochs']:,}"
    return (
        row["text"],
        *(["-"] * 3 if plus else trained),
        f"{clip['r2']:.2f}",
        f"{clip['mean_mm']:.2f}",
        f"{new['r2']:.2f}",
    )


_READINGS = (
    "reading | distance to the mesh, mm | R² of the offsets | absorbed | error of β | of joints, °"
)
_NAMES = {
    "closest": "closest iterate, one shape a person",
    "last": "last iterate",
    "sequence": "one shape a sequence",
}


def readings() -> str:
    """docs/results/alignment/readings.md, from `readings.json` beside it."""
    results = load("alignment/readings")
    rows = (
        (
            f"{_NAMES[name]} (`{' '.join(one['options']) or 'default'}`)",
            f"{one['distance_mm']:.2f}",
            f"{one['offsets_r2']:.3f}",
            f"{one['absorption']['absorbed']:.0%}",
            f"{one['betas_rms']:.2f}",
            f"{one['pose_deg']:.2f}",
        )
        for name, one in results["readings"].items()
    )
    return (
        "# Readings of the paper's alignment\n\n[What the text leaves open]"
        f"(../../alignment.md#what-the-text-leaves-open).\n\n{table(_READINGS, rows)}\n"
        f"Synthetic data beside their truth: {results['subjects']} people of "
        f"`{results['profile']}`, clips of about {results['frames']} frames. Made by "
        "`python -m benchmarks.alignment.readings --out docs/results/alignment/readings.json`.\n"
    )
