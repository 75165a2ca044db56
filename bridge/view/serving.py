"""A viser server that says nothing on its own and is gone afterwards."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout

import viser


@contextmanager
def serving(host: str, port: int) -> Iterator[viser.ViserServer]:
    """Serve while the block runs.

    Parameters
    ----------
    port : 0 for any that is free.
    """
    # What viser prints, it prints whether told to be quiet or not.
    with redirect_stdout(io.StringIO()):
        server = viser.ViserServer(host, port, verbose=False)
    try:
        yield server
    finally:
        with redirect_stdout(io.StringIO()):
            server.stop()
