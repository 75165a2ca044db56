"""A pose fitted to markers on flesh costs the bust; one by markers on bone gives it back."""

from __future__ import annotations

from benchmarks.prediction.marker_pose import _measured


def test_a_bony_pose_gives_the_bust_back() -> None:
    fitted, bony = _measured("dancing", seed=0).values()
    assert fitted["r2_bust_pose_alone"] > 0.3  # it swallowed flesh
    assert fitted["r2_bust_seen_up"] < 0.85
    assert min(bony["r2_bust_offsets"], bony["r2_bust_seen_up"]) > 0.95
    assert bony["r2_offsets"] > fitted["r2_offsets"]
