"""The viewer on a port of its own, for a browser without a window to look at."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from bridge.errors import DsnetError
from bridge.runs import Run
from bridge.view.performances import Performances
from bridge.view.repertoire import open_repertoire
from bridge.view.viewer import Viewer, serving
from tools.headless_chromium import why_missing


@dataclass(frozen=True, eq=False)
class ServedViewer:
    """A viewer whose predictions are made, and where it is served."""

    viewer: Viewer
    address: str

    @contextmanager
    def drawing(self) -> Iterator[None]:
        """Its frames are drawn as its clock says, in a thread."""
        thread = threading.Thread(target=self.viewer.run)
        thread.start()
        try:
            yield
        finally:
            self.viewer.stop()
            thread.join()


@contextmanager
def served_viewer(run: str | None, motion: Path | None = None) -> Iterator[ServedViewer]:
    """The viewer of a run, or of the packaged model, at its first motion or at `motion`.

    Raises
    ------
    DsnetError
        If the browser, or what is to be seen, is missing.
    """
    if why := why_missing():
        raise DsnetError(why, "a browser", "Install it.")
    performances = Performances(open_repertoire(None if run is None else Run(run), motion))
    with serving("127.0.0.1", 0) as server:
        viewer = Viewer(server, performances)
        try:
            performances.worker.wait()
            yield ServedViewer(viewer, f"http://127.0.0.1:{server.get_port()}")
        finally:
            performances.worker.stop()
