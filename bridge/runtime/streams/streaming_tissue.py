"""`dsnet_plus` tick by tick, for several persons at once; NumPy alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.paper import N_BETAS, THETA_SIZE
from bridge.tissue.load import Load, SkinnedNodes, in_rest_frame
from bridge.tissue.oscillators import FPS, NodeMechanics, OscillatorSheet
from bridge.tissue.trained_plus import TrainedPlus, static_features

_GROUPS_KEPT = 8
"""Persons who step together, side by side in memory: at 90 fps some do in turns."""


@dataclass(frozen=True, eq=False)
class TissueOfPerson:
    """What does not change."""

    mechanics: NodeMechanics
    skin: SkinnedNodes
    constant_m: NDArray[np.float32] | None
    """(V, 3) the static part that no pose changes, if there is one."""


@dataclass(frozen=True, eq=False)
class TissuePast:
    """All that the tissue's future depends on."""

    person: TissueOfPerson
    ticks: int
    """Since the beginning; the newest pose is this one's."""
    places: NDArray
    """(K, 3) of the nodes, metres."""
    places_before: NDArray
    """A tick before that."""
    turns: NDArray
    """(K, 3, 3) skinning rotations of the nodes."""
    felt: NDArray
    """(N, K, 3) loads, m/s^2, up to the newest pose but one, the newest first."""
    now: NDArray
    """(K, 3) offsets of the nodes, metres, `look_ahead` ticks ago."""
    before: NDArray
    """A step of the oscillators before that."""


@dataclass(frozen=True, eq=False)
class _SideBySide:
    skin: SkinnedNodes
    sheet: OscillatorSheet
    inertia_gain: NDArray
    gravity_gain: NDArray

    def felt(self, load: Load) -> NDArray[np.float32]:
        return self.inertia_gain * load.inertia + self.gravity_gain * load.gravity


class StreamingTissue:
    """A `StreamingModel` whose codes are offsets (K, 3) of the nodes, metres.

    A tick's load is smoothed over poses that lie `look_ahead` ticks ahead at most, and its
    acceleration needs the pose after: it moves the next tick's offsets.

    Parameters
    ----------
    model : a trained `dsnet_plus`.
    body : the body model that it was trained with.
    """

    def __init__(self, model: TrainedPlus, body: BodyModelData) -> None:
        self.look_ahead = model.look_ahead
        self._model, self._body = model, body
        self._by_pose = bool(model.static.by_pose_m.any())
        self._skin = SkinnedNodes(body, model.nodes.vertices, np.zeros(N_BETAS))
        self._sheet: OscillatorSheet | None = None
        self._together = lru_cache(_GROUPS_KEPT)(self._side_by_side)

    def join(self, betas: NDArray) -> TissueOfPerson:
        """Costs some 20 ms."""
        model, body = self._model, self._body
        static_m = model.static_m(body, betas, np.zeros((1, THETA_SIZE)))
        return TissueOfPerson(
            mechanics=model.mechanics(body, betas),
            skin=self._skin.of_person(betas),
            constant_m=None if static_m is None or not static_m.any() else static_m[0],
        )

    def begin(self, person: TissueOfPerson, theta: NDArray) -> tuple[TissuePast, NDArray]:
        """Costs some 30 ms: tissue of any stiffening is at rest only where a solver finds it."""
        places, turns = (found[0] for found in person.skin.skin(theta[None]))
        felt = person.mechanics.felt(in_rest_frame(np.zeros_like(places)[None], turns[None]))[0]
        settled = OscillatorSheet(person.mechanics, self._model.nodes.laplacian).settled(felt)
        taps = len(person.mechanics.taps)
        past = TissuePast(
            person, 0, places, places, turns, felt[None].repeat(taps, axis=0), settled, settled
        )
        return past, settled

    def advance(
        self, pasts: Sequence[TissuePast], theta: NDArray
    ) -> list[tuple[TissuePast, NDArray | None]]:
        """All with one product by the nodes' coupling."""
        together = self._together(tuple(past.person for past in pasts))
        places, turns = together.skin.skin(theta)
        felt = together.felt(self._load_before(pasts, places))
        remembered = [
            np.concatenate([one[None], past.felt[:-1]])
            for one, past in zip(felt, pasts, strict=True)
        ]
        now, before = self._frames(together, pasts, np.stack(remembered, axis=2))
        found = []
        for row, past in enumerate(pasts):
            moved = replace(
                past,
                ticks=past.ticks + 1,
                places=places[row],
                places_before=past.places,
                turns=turns[row],
                felt=remembered[row],
            )
            if moved.ticks > self.look_ahead:
                moved = replace(moved, now=now[:, row].copy(), before=before[:, row].copy())
            found.append((moved, moved.now if moved.ticks > self.look_ahead else None))
        return found

    def finish(self, past: TissuePast) -> list[NDArray]:
        """As over a whole motion, whose last frame stands still and goes on for ever."""
        together = self._together((past.person,))
        turns, still = past.turns[None], np.zeros_like(past.places)[None]
        felt = together.felt(in_rest_frame(still, turns))
        queue, now, before = past.felt, past.now[:, None], past.before[:, None]
        found = []
        # One load is missing for each tick of look-ahead; of a shorter motion, more.
        for tick in range(past.ticks + 1, past.ticks + 1 + self.look_ahead):
            queue = np.concatenate([felt, queue[:-1]])
            if tick > self.look_ahead:
                load = self._smoothed(past, queue[:, :, None])
                now, before = together.sheet.frame(now, before, load)
                found.append(now[:, 0])
        return found

    def offsets_m(
        self, people: Sequence[TissueOfPerson], codes: Sequence[NDArray], theta: NDArray
    ) -> NDArray[np.float32]:
        """Spread over the skin, and the static part."""
        at_nodes = np.stack(codes)
        if self._by_pose:
            features = static_features(self._body, theta)
            at_nodes = at_nodes + np.tensordot(features, self._model.static.by_pose_m, 1)
        offsets_m = self._model.nodes.spread(at_nodes)
        for row, person in zip(offsets_m, people, strict=True):
            if person.constant_m is not None:
                row += person.constant_m
        return offsets_m

    def latents(self, code: NDArray) -> None:
        """It has none."""

    def _load_before(self, pasts: Sequence[TissuePast], places: NDArray) -> Load:
        """(B, K, 3) of the poses before those at `places`: these have no acceleration yet."""
        middle = np.stack([past.places for past in pasts])
        acceleration = places - 2 * middle + np.stack([past.places_before for past in pasts])
        acceleration *= FPS**2
        for row, past in enumerate(pasts):
            if not past.ticks:  # the first pose, as over a whole motion, stands still
                acceleration[row] = 0
        return in_rest_frame(acceleration, np.stack([past.turns for past in pasts]))

    def _frames(
        self, together: _SideBySide, pasts: Sequence[TissuePast], felt: NDArray
    ) -> tuple[NDArray, NDArray]:
        """Offsets (K, B, 3) a frame later under what was felt (N, K, B, 3), and those before."""
        now, before = (
            np.stack([getattr(past, name) for past in pasts], axis=1) for name in ("now", "before")
        )
        return together.sheet.frame(now, before, self._smoothed(pasts[0], felt))

    def _smoothed(self, past: TissuePast, felt: NDArray) -> NDArray[np.float32]:
        taps = past.person.mechanics.taps
        return np.asarray(sum(t * f for t, f in zip(taps, felt, strict=True)), np.float32)

    def _side_by_side(self, people: tuple[TissueOfPerson, ...]) -> _SideBySide:
        mechanics = [person.mechanics for person in people]
        if self._sheet is None:
            self._sheet = OscillatorSheet(mechanics[0], self._model.nodes.laplacian)
        return _SideBySide(
            SkinnedNodes.of_people([person.skin for person in people]),
            self._sheet.of_people(mechanics),
            np.stack([one.inertia_gain for one in mechanics]),
            np.stack([one.gravity_gain for one in mechanics]),
        )
