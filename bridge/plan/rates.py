"""What the stages of a finished run took; written by tools/update_rates.py, never typed."""

from __future__ import annotations

from bridge.plan.costs import MeasuredRun, Rate

MEASURED = MeasuredRun("demo", "Linux AMD EPYC, 2 cores", "2026-11-24")
RATES = {
    "truth": Rate(41.2, 11756, 536),
    "corpus": Rate(5.1, 6376, 536),
    "align": Rate(86.5, 1007040, 426),
    "align_robust": Rate(21.9, 6376, 584),
    "train-ae": Rate(136.0, 11712, 1335),
    "encode": Rate(10.0, 6376, 153),
    "train": Rate(30.8, 39000, 787),
    "train_plus": Rate(48.8, 51501333, 1155),
    "predict": Rate(1.9, 23512, 753),
    "predict_plus": Rate(5.2, 6345, 300),
    "decode": Rate(25.0, 19035, 0),
    "evaluate": Rate(24.1, 19035, 652),
    "report": Rate(48.0, 90000, 562),
}
