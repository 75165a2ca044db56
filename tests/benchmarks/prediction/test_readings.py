"""One law, accelerations read twice: the table, and that smooth motions are read alike."""

from __future__ import annotations

import json

import numpy as np

from benchmarks.laws.second_tissue_simulation import SecondTissueSimulator
from benchmarks.prediction import readings
from bridge.body import load_body_model
from bridge.measure.metrics import ErrorSums
from tests.forged.lively import lively


def test_clips_are_summed_up_by_kind_and_person(tmp_path):
    def clip(name: str, cell: str, again: float, plus: float) -> dict:
        return {"name": name, "cell": cell, "read_otherwise": again, "dsnet_plus": plus}

    clips = [
        clip("50004_bvh_01", "known_person_unseen_motion", 0.8, 0.7),
        clip("50004_bvh_02", "known_person_unseen_motion", 0.6, 0.5),
        clip("50004_bvh_03", "known_person_unseen_motion", 0.9, 0.6),
        clip("99001_dancing", "new_person_unseen_motion", 0.98, 0.9),
    ]
    path = tmp_path / "readings.json"
    path.write_text(json.dumps({"runs": {"bed": clips}, "command": "the command"}))
    rows = [line for line in readings.markdown(path).splitlines() if line.startswith("| `")]
    assert rows == [
        "| `bed` | invented | new person | 1 | 0.980 | 0.980 | 0.900 | 0.900 |",
        "| `bed` | recorded | known person | 3 | 0.800 | 0.600 | 0.600 | 0.500 |",
    ]


def test_what_is_read_otherwise_is_noise():
    """Calm motion gives the same flesh through three frames as through five, with a tremor of a
    millimetre it does not."""
    body, betas = load_body_model("embedded:female"), np.zeros(10)
    theta = 0.05 * lively(40).astype(np.float64)
    trembling = theta.copy()
    trembling[:, 66:] += 1e-3 * np.random.default_rng(0).standard_normal((40, 3))
    r2s = []
    for motion in (theta, trembling):
        sums = ErrorSums()
        sums.add(
            *(
                SecondTissueSimulator(body, betas, parabola_frames=frames).offsets(motion, 60.0)
                for frames in (3, 5)
            )
        )
        r2s.append(sums.r2)
    assert r2s[0] > 0.99
    assert r2s[1] < 0.8
