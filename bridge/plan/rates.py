"""What the stages of a finished run took; written by tools/update_rates.py, never typed."""

from __future__ import annotations

from bridge.plan.costs import MeasuredRun, Rate

MEASURED = MeasuredRun("demo", "Linux x86_64, 2 cores", "2026-11-22")
RATES = {
    "truth": Rate(89.8, 11756, 988),
    "corpus": Rate(20.3, 6376, 988),
    "align": Rate(160.6, 1007040, 895),
    "align_robust": Rate(37.7, 6376, 1280),
    "train-ae": Rate(109.8, 11712, 1578),
    "encode": Rate(8.3, 6376, 530),
    "train": Rate(66.4, 39000, 750),
    "train_plus": Rate(95.6, 51501333, 1021),
    "predict": Rate(2.5, 23512, 688),
    "predict_plus": Rate(8.2, 6345, 665),
    "decode": Rate(22.5, 19035, 108),
    "evaluate": Rate(52.9, 19035, 900),
    "report": Rate(38.8, 3240000, 558),
}
