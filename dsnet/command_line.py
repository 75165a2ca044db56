"""What a person reads of the command line: the options of a command, and what a mistake meant."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path

from bridge.errors import DsnetError

_NAMED = {
    "predict": ("--motion", "--out"),
    "export": ("--motion", "--out"),
    "view": ("--motion",),
}
"""The options that are meant by words without a name; of all other commands it is the run."""


def refuse_words_without_name(command: str, options: Sequence[str]) -> None:
    """DsnetError with the command line that was meant, if options begin with words of no name."""
    count = next((i for i, word in enumerate(options) if word.startswith("-")), len(options))
    names = _NAMED.get(command, ("--run",))
    if not 0 < count <= len(names) or {"-h", "--help"} & {*options}:
        return
    words, rest = options[:count], options[count:]
    meant = ["dsnet", command]
    if command == "export" and not any(word.partition("=")[0] == "--to" for word in rest):
        beside = Path(words[0].removeprefix("sample:")).with_suffix(".usd")
        words = [words[0], words[1] if count > 1 else str(beside)]
        suffix = Path(words[1]).suffix[1:].lower()
        meant += ["--to", "usd" if suffix in ("", "usda", "usdc") else suffix]
    for name, word in zip(names, words, strict=False):
        meant += [name, word]
    raise DsnetError(
        f"{shlex.join(['dsnet', command, *options[:count]])}, words without a name",
        "each after its option",
        f"Run: {shlex.join([*meant, *rest])}",
    )
