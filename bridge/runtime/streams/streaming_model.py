"""What `StreamingBodies` asks of a model that moves several persons, tick by tick."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

from numpy.typing import NDArray


class StreamingModel(Protocol):
    """A trained predictor, 60 ticks a second.

    It keeps nothing itself: what it remembers of a person is a value that it is given back. What
    it makes of a tick is a code, which may be mixed linearly with the next one's.
    """

    look_ahead: int
    """Ticks after which a tick's code is known."""

    def join(self, betas: NDArray) -> Any:
        """What does not change of a person of shape betas (10,)."""
        ...

    def begin(self, person: Any, theta: NDArray) -> tuple[Any, NDArray]:
        """A past that begins at rest in the pose theta (69,), and that tick's code."""
        ...

    def advance(self, pasts: Sequence[Any], theta: NDArray) -> list[tuple[Any, NDArray | None]]:
        """Each person's past with one tick more, at theta (B, 69), and the code of `look_ahead`
        ticks ago; None if that lies before the beginning, or is it and so was given."""
        ...

    def finish(self, past: Any) -> list[NDArray]:
        """The codes still to come, of `look_ahead` ticks at most, if the motion ends here."""
        ...

    def offsets_m(self, people: Sequence[Any], codes: Sequence[NDArray], theta: NDArray) -> NDArray:
        """(B, V, 3) skin offsets in the rest pose, metres, of persons in poses theta (B, 69)."""
        ...

    def latents(self, code: NDArray) -> NDArray | None:
        """(100,) of a code, if that is what it is."""
        ...
