"""docs/paper.md: what each departure from the paper's words buys."""

from __future__ import annotations

from typing import Any

from tools.pages.blocks import load, table

_HEAD = (
    "from the paper's words to today's run | autoencoder's R², validation meshes | "
    "DSNet's R², held-out clip | mean error, mm"
)


def ladder() -> str:
    """The table of `docs/results/departures.json`, and how it was made."""
    results = load("departures")
    first, *_ = rows = results["rows"]
    return (
        f"{table(_HEAD, map(_row, rows))}\n"
        "R² is 1 for a perfect code or prediction and 0 for SMPL alone; of the clip it is that of "
        f"the posed mesh. Synthetic data, run `{results['run']}` aligned by SGD, "
        f"{results['epochs']} epochs of DSNet, seed {results['seed']} ({first['machine']}).\n"
        "Made by `python -m benchmarks.departures --run demo --out docs/results/departures.json"
        f"{_option('steps', results, 175)}{_option('literal_steps', results, 0)}`.\n"
    )


def _option(name: str, results: dict[str, Any], default: int) -> str:
    return "" if results[name] == default else f" --{name.replace('_', '-')} {results[name]}"


def _row(row: dict[str, Any]) -> tuple[str, ...]:
    clip = row["cells"]["validation"]
    text = f"{row['text']} ({row['autoencoder_steps']:,} steps)"
    return text, f"{row['autoencoder_r2']:.3f}", f"{clip['r2']:.2f}", f"{clip['mean_mm']:.2f}"
