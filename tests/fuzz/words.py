"""Names and lists of numbers, as they stand on a command line."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from hypothesis import strategies as st

from bridge import DsnetError
from bridge.motion.readers.amass import motion_path
from dsnet.prediction.controls import Controls
from dsnet.prediction.shapes import parse_shape
from tests.fuzz.mutations import ODD_NAMES, Draw, Files


@st.composite
def files(draw: Draw) -> Files:
    known = [
        "sample:",
        "walking",
        "tall",
        "heavy",
        "height=",
        "weight=",
        "belly=",
        "1e400",
        "nan",
        "-1",
        ",",
        "=",
        "182",
        "0.5",
    ]
    words = (*known, " ", "1,2,3,4,5,6,7,8,9,10", *ODD_NAMES)
    parts = draw(st.lists(st.one_of(st.sampled_from(words), st.text(max_size=8)), max_size=6))
    return {"words.txt": "".join(parts).encode("utf-8", "replace")}


def read(folder: Path) -> None:
    """One text as every kind of name; the first that is refused is told, so all are tried."""
    text = (folder / "words.txt").read_bytes().decode()
    tries: list[Callable[[], object]] = [
        lambda: motion_path(text if text.startswith("sample:") else "sample:" + text),
        lambda: parse_shape(text.split()),
        Controls(betas=text).check,
        Controls(part_gain=(text,)).check,
        Controls(shape=(text,)).check,
    ]
    refusals = []
    for attempt in tries:
        try:
            attempt()
        except DsnetError as error:
            refusals.append(error)
    if refusals:
        raise refusals[-1]
