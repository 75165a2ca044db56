"""How far long work is: done of all, rate and time left, where the output is a terminal."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TypeVar

from tqdm import tqdm

Item = TypeVar("Item")


def progress(
    items: Iterable[Item] = (), *, what: str, unit: str, total: int | None = None
) -> tqdm[Item]:
    """A bar on stderr that counts items as they are taken, or what its `update` is told of.

    Parameters
    ----------
    what : the work.
    unit : what is counted.
    total : how many there will be, where `items` have no length.
    """
    # disable=None: silent where stderr is no terminal.
    return tqdm(items, desc=what, unit=unit, total=total, disable=None)
