"""One thread that does the latest work asked for, and drops what nobody wants any more."""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable, Iterator, Mapping

Steps = Callable[[], Iterator[None]]
"""Work in steps of well under a second: between two of them it can be dropped."""


class Dropped(Exception):
    """Nobody wants the work any more that was under way."""


class LatestWork:
    """Does pieces of work one after another, in the order in which they were last asked for."""

    def __init__(self) -> None:
        self.failed: dict[Hashable, Exception] = {}
        """What went wrong, by what was to be done; such work is not tried again."""
        self._wanted: dict[Hashable, Steps] = {}
        self._changed, self._stopped = threading.Condition(), False
        self._thread = threading.Thread(target=self._work, daemon=True)
        self._thread.start()

    def want(self, work: Mapping[Hashable, Steps]) -> None:
        """Do this and nothing else; what is under way and still wanted goes on where it is."""
        with self._changed:
            self._wanted = {key: one for key, one in work.items() if key not in self.failed}
            self._changed.notify_all()

    def go_on(self, key: Hashable) -> None:
        """For work within one of its steps, where that is long.

        Raises
        ------
        Dropped
            If nobody wants it any more.
        """
        if key not in self._wanted:
            raise Dropped

    def wait(self, timeout_s: float | None = None) -> bool:
        """Wait until nothing is left to do; False if that took too long."""
        with self._changed:
            return self._changed.wait_for(lambda: not self._wanted, timeout_s)

    def stop(self) -> None:
        """End the thread after its current step."""
        with self._changed:
            self._stopped, self._wanted = True, {}
            self._changed.notify_all()
        self._thread.join()

    def _work(self) -> None:
        while (key := self._next()) is not None:
            if self._do(key):
                with self._changed:
                    self._wanted.pop(key, None)
                    self._changed.notify_all()

    def _do(self, key: Hashable) -> bool:
        """Whether it was done to its end, good or bad."""
        steps = self._wanted.get(key)
        try:
            for _ in steps() if steps else ():
                if key not in self._wanted:
                    return False
        except Dropped:
            return False
        # A thread that dies would leave a viewer that waits for ever.
        except Exception as error:
            self.failed[key] = error
        return True

    def _next(self) -> Hashable | None:
        with self._changed:
            self._changed.wait_for(lambda: self._stopped or self._wanted)
            return None if self._stopped else next(iter(self._wanted))
