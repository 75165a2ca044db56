"""Figure 9: known and new people in motions that training has seen and in others."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

from bridge.motion import MotionSequence
from dsnet.report import stage_report
from dsnet.report.bodies import Scene


def figure9(*named: tuple[str, str, str]) -> dict[str, tuple[bool, ...]]:
    """Which of known and new people each row has, of sequences (subject, motion, cell)."""
    sequences = {
        f"{subject}_{motion}": MotionSequence(f"{subject}_{motion}", subject, motion, 0, 9, 60.0)
        for subject, motion, _ in named
    }
    measured = [
        {"name": name, "split": "test", "person": cell.partition("_")[0], "cell": cell}
        for name, (_, _, cell) in zip(sequences, named, strict=True)
    ]
    evaluate = SimpleNamespace(manifest={"per_sequence": measured})
    scene = SimpleNamespace(predicted=lambda: sequences, stages={"evaluate": evaluate})
    shown = stage_report._subjects_of_figure9(cast("Scene", scene))
    return {row: tuple(map(bool, pair)) for row, pair in shown.items()}


def test_figure_9_finds_its_groups_by_what_a_motion_is(capsys):
    """Motions are named as MPI_mosh's are; only the held-out jump has a name of the paper's."""
    rows = figure9(
        ("50004", "one_leg_jump", "known_person_known_motion"),
        ("50002", "misc_dancing_hiphop", "known_person_unseen_motion"),
        ("50020", "irish_dance", "known_person_unseen_motion"),
        ("00008", "irish_dance", "new_person_unseen_motion"),
        ("50004", "misc_1", "known_person_unseen_motion"),
        ("00008", "misc", "new_person_unseen_motion"),
        ("50004", "simple_crouch2", "known_person_unseen_motion"),
        ("00096", "simple_crouch", "new_person_unseen_motion"),
        ("00096", "jumping_jacks", "new_person_known_motion"),
        ("50025", "jumping_jacks_1", "known_person_known_motion"),
    )
    assert rows == {
        "one leg jump": (True, False),
        "jumping jacks": (True, True),
        "irish dance": (True, True),
        "simple crouch": (True, True),
    }
    assert capsys.readouterr().err == ""


def test_figure_9_tells_which_groups_a_run_lacks(capsys):
    figure9(
        ("50004", "one_leg_jump", "known_person_known_motion"),
        ("50002", "misc", "known_person_unseen_motion"),
    )
    assert capsys.readouterr().err == (
        "dsnet: Figure 9 is without new people in known motions, new people in unseen motions: "
        "the run has no such sequence\n"
    )
