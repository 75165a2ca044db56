"""A recording of what the viewer shows: one HTML file that plays in any browser, offline."""

from __future__ import annotations

from bridge.view.live_scene import LiveScene
from bridge.view.performances import Performances
from bridge.view.selection import Selection, Shown
from bridge.view.serving import serving

FPS = 30.0
"""Frames a second of a recording: every second one of a motion."""


def record(performances: Performances, selection: Selection) -> str:
    """The page: bodies, labels and colours, with a bar to play, pause, scrub and change the speed.

    Waits until everything selected has been computed.

    Raises
    ------
    DsnetError
        If a motion or a predictor cannot be read.
    """
    shown = Shown(performances, selection)
    performances.worker.wait()
    for asked in shown.asked:
        if failure := performances.worker.failed.get(asked):
            raise failure
    repertoire = performances.repertoire
    # A server of its own: those who look on meanwhile see nothing of it.
    with serving("127.0.0.1", 0) as server:
        scene = LiveScene(server, repertoire.body.faces, repertoire.origin, sparse=False)
        scene.frame_bodies(len(shown.asked))
        scene.draw(list(shown.posed(0)), selection)
        serializer = server.get_scene_serializer()
        step = max(round(performances.motion(selection.way).fps / FPS), 1)
        for frame in range(0, shown.frames, step):
            scene.draw(list(shown.posed(frame)), selection)
            serializer.insert_sleep(1 / FPS)
        return serializer.as_html()
