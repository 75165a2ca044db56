"""Each number that the paper prints, beside ours."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from bridge.paper import NUMBERS, PaperNumber, Value


@dataclass(frozen=True)
class Measured:
    """A number of ours, read from what the run built."""

    value: Value | None
    """The number; None when the run has none."""
    why: str = ""
    """Reason for which it may differ from the paper's."""


@dataclass(frozen=True)
class ComparisonRow:
    """One row of the report's first table."""

    section: str
    quantity: str
    paper: str
    ours: str
    verdict: str
    """`same`, `differs: why`, or `paper does not say`."""


def compare(measured: Mapping[str, Measured]) -> list[ComparisonRow]:
    """A row for each of the paper's numbers, in the paper's order.

    Raises
    ------
    KeyError
        If there is no entry, not even an empty one, for a number of the paper's.
    """
    return [_row(number, measured[number.key]) for number in NUMBERS]


def verdict(number: PaperNumber, ours: Measured) -> str:
    """`same` only for equal numbers in a stated unit; a difference always names its reason."""
    if number.value is None:
        return "paper does not say"
    if ours.value == number.value and number.unit != "unit not stated":
        return "same"
    why = ours.why or ("not part of this run" if ours.value is None else "not explained")
    return f"differs: {why}"


def format_value(value: Value | None, unit: str = "") -> str:
    """A number for people: thousands set apart, small ones with four significant digits."""
    if value is None:
        return "-"
    if isinstance(value, tuple):
        text = ", ".join(map(_format_one, value)) if len(value) > 2 else _format_range(value)
    else:
        text = value if isinstance(value, str) else _format_one(value)
    return f"{text} {unit}".strip() if unit in ("", "%", "s", "1/s", "mm") else f"{text} ({unit})"


def _row(number: PaperNumber, ours: Measured) -> ComparisonRow:
    # Where the paper states no unit, ours carries its own in the text.
    unit = "" if number.unit == "unit not stated" else number.unit
    return ComparisonRow(
        number.section,
        number.quantity,
        format_value(number.value, number.unit) if number.value is not None else "-",
        format_value(ours.value, unit if ours.value is not None else ""),
        verdict(number, ours),
    )


def _format_range(value: tuple[int | float, ...]) -> str:
    return " to ".join(map(_format_one, value))


def _format_one(value: int | float) -> str:
    if isinstance(value, int) or float(value).is_integer():
        return f"{int(value):,}"
    return f"{value:.4g}"
