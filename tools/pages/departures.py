"""docs/paper.md: what each departure from the paper's words buys."""

from __future__ import annotations

from typing import Any

from tools.pages.blocks import load, table

_HEAD = (
    "from the paper's words to this repository | autoencoder's steps | its R², validation meshes | "
    "R², held-out clip | mean error, mm | R², new people, known motions"
)


def ladder() -> str:
    """The table of `docs/results/departures.json`, and how it was made."""
    results = load("departures")
    first, *_ = rows = results["rows"]
    longer = f" --longer {results['longer']}" if results["longer"] else ""
    return (
        f"{table(_HEAD, map(_row, rows))}\n"
        "R² is 1 for a perfect code or prediction and 0 for SMPL alone; of predictions it is of "
        f"the posed mesh. Synthetic data, run `{results['run']}`, "
        f"{results['epochs']} epochs of DSNet, seed {results['seed']} ({first['machine']}).\n"
        "Made by `python -m benchmarks.departures --run demo --out docs/results/departures.json"
        f"{longer}`.\n"
    )


def _row(row: dict[str, Any]) -> tuple[str, ...]:
    clip, new = row["cells"]["validation"], row["cells"]["new_person_known_motion"]
    plus = row["predictor"] == "dsnet_plus"
    code = ("-", "-") if plus else (f"{row['autoencoder_steps']:,}", f"{row['autoencoder_r2']:.2f}")
    return row["text"], *code, f"{clip['r2']:.2f}", f"{clip['mean_mm']:.2f}", f"{new['r2']:.2f}"
