"""A refusal is one line that a terminal shows and does not obey."""

from __future__ import annotations

import pytest

from bridge import DsnetError
from bridge.errors import notify


@pytest.mark.parametrize("hostile", ["a\nb", "\x1b[2J", "\x07", "\u202egnp", "\x9b31m", "\ud800"])
def test_control_characters_do_not_reach_the_terminal(
    hostile: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert str(DsnetError(f"file {hostile}", "a name", "Rename it.")).isprintable()
    notify(f"{hostile} left out")
    assert capsys.readouterr().err.removesuffix("\n").isprintable()


def test_letters_of_every_language_are_shown() -> None:
    assert str(DsnetError("Läufer 走る.npz", "x", "y")).startswith("Läufer 走る.npz; expected x")


def test_what_is_very_long_is_shortened() -> None:
    assert len(str(DsnetError("x" * 10**6, "y" * 10**6, "Shorten it."))) < 10_000
