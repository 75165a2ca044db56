"""Gains: what multiplies the skin's offsets, by part of the body, and how far flesh lets it.

Flesh has a largest strain: a gain of 3 would tear the skin of a heavy body that lands, and turn it
inside out. So what a gain g adds to the prediction is limited in each part of the body and frame,

    min(g, 1) + a / sqrt(1 + a^2 (x + x^3)^2),    a = max(g - 1, 0),    x = E / 0.36

E is the strain that the prediction itself has there: of all edges of the part the 16-norm of
|d_i - d_j| over the edge's length on the mean body, so nearly the largest. A gain of at most 1
multiplies; a larger one nearly does where the flesh is calm, never gives less than 1 or than a
smaller gain, and adds within a part a strain of at most 0.36 / (1 + x^2): little where the
prediction alone strains the skin. All of it is smooth in the offsets. Parts are blended as they
fade, left and right are one part.

`dsnet/view/web/strain.js` computes the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from bridge.body import BodyModelData
from bridge.body.parts import GROUPS, PARTS, part_weights
from bridge.options import Bounds, numbers_by_name
from bridge.tissue.nodes import per_frame

GAINS = Bounds(0, 20)
"""What a gain may be."""
LARGEST_STRAIN = 0.36
"""That a gain may add: the mean over 39 women of the peak strain of breast skin, bare, in walking;
31 % in standing, 46 % in running, 93 % the largest of anybody (Norris, Mills, Sanchez and
Wakefield-Scurr 2020, doi:10.1136/bmjsem-2020-000770). At running's 46 % single triangles turn."""
_DOUBLINGS = 3
"""Of the exponent of |d_i - d_j|^2: 2^3 is the 16-norm."""
_SHORTEST_M = 1e-3
"""Shorter edges count as so long: where two vertices are one, nothing strains."""


def gains_of_parts(part_gain: Sequence[str]) -> NDArray[np.float64]:
    """(11,) the gains of `PARTS`, 1 where none is given.

    `part_gain` is `part=gain` of `PARTS` and `GROUPS`; a part's gain counts more than its group's.
    """
    remedy = "Pass --part-gain belly=2 chest=0.5."
    gains = numbers_by_name("--part-gain", part_gain, (*PARTS, *GROUPS), GAINS, remedy)
    group_of = {part: group for group, parts in GROUPS.items() for part in parts}
    return np.array([gains.get(part, gains.get(group_of.get(part, ""), 1.0)) for part in PARTS])


def limited_gains(of_parts: ArrayLike, strains: ArrayLike) -> NDArray[np.float64]:
    """(..., 11) what is left of gains of parts (11,) at strains (..., 11) of the prediction."""
    wanted, x = np.asarray(of_parts), np.asarray(strains) / LARGEST_STRAIN
    more = np.maximum(wanted - 1.0, 0.0)
    return np.minimum(wanted, 1.0) + more / np.sqrt(1.0 + np.square(more * (x + x**3)))


class Gains:
    """The gains of a body's vertices in every frame.

    Parameters
    ----------
    of_parts : one number, or one for each of `PARTS` (11,).
    """

    def __init__(self, body: BodyModelData, of_parts: ArrayLike) -> None:
        self._body = body
        self.of_parts = np.broadcast_to(np.asarray(of_parts, np.float64), (len(PARTS),))
        self.limited = bool((self.of_parts > 1.0).any())
        """Whether strain limits them, so that they differ from frame to frame."""

    @cached_property
    def shares(self) -> NDArray[np.float32]:
        """(V, 11) how much of each part's gain a vertex has."""
        return part_weights(self._body).astype(np.float32)

    @cached_property
    def unlimited(self) -> NDArray[np.float32]:
        """(V, 1) as they were asked for, or () where all are the same."""
        if (self.of_parts == self.of_parts[0]).all():
            return np.asarray(self.of_parts[0], np.float32)
        return (part_weights(self._body) @ self.of_parts).astype(np.float32)[:, None]

    def left_of_parts(self, offsets_m: NDArray) -> NDArray[np.float32]:
        """(T, 11) that the strain of predicted offsets (T, V, 3), metres, leaves of them."""
        return limited_gains(self.of_parts, self.strains(offsets_m)).astype(np.float32)

    def strains(self, offsets_m: NDArray) -> NDArray[np.float64]:
        """(T, 11) of offsets (T, V, 3), metres, in each part."""
        strained, shares = self._edges
        with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is refused later
            pulled = per_frame(strained, np.asarray(offsets_m, np.float32))
            powers = np.einsum("tex,tex->te", pulled, pulled, dtype=np.float64)
            for _ in range(_DOUBLINGS):
                powers *= powers
            return (powers @ shares) ** (0.5 / 2**_DOUBLINGS)

    @cached_property
    def _edges(self) -> tuple[sp.csr_matrix, NDArray[np.floating]]:
        """(E, V) differences along edges over their lengths, and (E, 11) how much each counts."""
        (one, other), lengths_m = edges_of(self._body)
        row, each = np.arange(len(one)), 1.0 / lengths_m
        places = np.concatenate([row, row]), np.concatenate([one, other])
        values = np.concatenate([each, -each]).astype(np.float32)
        strained = sp.csr_matrix((values, places), shape=(len(one), self._body.vertex_count))
        return strained, ((self.shares[one] + self.shares[other]) / 2.0) ** 2.0 ** (_DOUBLINGS + 1)


def edges_of(body: BodyModelData) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Vertices (2, E) of a body's edges, and their lengths (E,) on the mean body, metres."""
    faces, template = np.asarray(body.faces, np.int64), np.asarray(body.v_template, np.float64)
    both = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    one, other = np.unique(np.sort(both), axis=0).T
    lengths_m = np.linalg.norm(template[one] - template[other], axis=1)
    return np.stack([one, other]), np.maximum(lengths_m, _SHORTEST_M)
