"""`dsnet view`: predictions in a browser, as they move."""

from __future__ import annotations

import socket
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from bridge.errors import DsnetError, notify
from bridge.installation import require_package
from bridge.options import Bounds, PositiveFloat
from bridge.runs import Run
from bridge.runtime.controls import Controls
from bridge.view.performances import Performances
from bridge.view.repertoire import open_repertoire


@dataclass(frozen=True)
class ViewConfig(Controls):
    """Show truth, SMPL alone and predictors in a browser, and let them be played with.

    What says how a body moves is where the controls stand at the start."""

    run: str | None = None
    """Run whose predictors and motions are shown; the small model that comes with the package
    when left out, of the motion's gender."""
    motion: Path | None = None
    """AMASS `.npz`, a BVH, or a sample such as `sample:walking`, that is shown first."""
    host: str = "127.0.0.1"
    """Address to serve on; at another one, others on the network can look on too."""
    port: Annotated[int, Bounds(0, 65535)] = 8080
    """Port to serve on; 0 takes any that is free."""
    seconds: PositiveFloat = 20.0
    """How much of each motion is shown; 5 MB of memory a second for each predictor."""
    record: Path | None = None
    """Write a recording of what is shown at the start, one self-contained HTML file, and end."""


PROFILES = dict.fromkeys(("smoke", "demo", "paper"), ViewConfig())


def main(config: ViewConfig) -> None:
    """Serve the viewer until it is interrupted, or write the recording."""
    config.check()
    require_package("viser", "viewer", "dsnet view")
    _check_address(config.host, config.port)
    run = None if config.run is None else Run(config.run)
    repertoire = open_repertoire(run, config.motion, config)
    performances = Performances(repertoire, config.seconds)
    if config.record is not None:
        write_recording(config.record, performances, config)
        return
    from bridge.view.viewer import Viewer, serving

    with serving(config.host, config.port) as server:
        viewer = Viewer(server, performances, config)
        owner = performances.repertoire.owner
        address = f"http://{config.host}:{server.get_port()}"
        notify(f"{owner}: open {address} in a browser; Ctrl-C ends it")
        try:
            viewer.run()
        finally:
            performances.worker.stop()


def _check_address(host: str, port: int) -> None:
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(
            host, port, type=socket.SOCK_STREAM
        )[0]
        with socket.socket(family, kind, protocol) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(address)
    except OSError as error:
        raise DsnetError(
            f"--host {host} --port {port}, where nothing can be served ({error.strerror})",
            "an address of this machine and a free port",
            "Pass --port 0 for any free port, or end what serves there.",
        ) from error


def write_recording(
    path: Path, performances: Performances, controls: Controls | None = None
) -> None:
    """Write the recording of what is shown first; all or nothing."""
    from bridge.export.output import new_path
    from bridge.view.viewer import first_selection, record

    with new_path(path, "--record") as partial:
        try:
            page = record(performances, first_selection(performances, controls))
        finally:
            performances.worker.stop()
        partial.write_text(page, encoding="utf-8", newline="\n")
    notify(f"{path}: {len(page) / 1e6:.1f} MB; open it in any browser")
