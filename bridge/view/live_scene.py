"""Bodies, labels, the scale of colours and the floor in viser's scene.

viser's meshes that can move have one colour each. So a body is as many meshes as there are bands of
colour, and a face belongs to the band of its value, the mean over its corners.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import viser
from numpy.typing import NDArray

from bridge.view.selection import OVERLAID, PLAIN, Posed, Selection

CLAY = (219, 201, 186)
COLOURS = (
    (252, 240, 178), (254, 196, 136), (253, 154, 106), (246, 110, 92), (224, 76, 103),
    (188, 57, 120), (150, 44, 128), (114, 31, 129), (76, 17, 122), (37, 18, 85),
)  # fmt: skip
"""The report's colours of sizes, from none to `full_m` and more."""
BANDS = len(COLOURS)
_APART_M = 1.3
_SEE_THROUGH = 0.35
_FIELD_OF_VIEW_DEG = 40.0
_GRID_M = 1 / 4096
"""To which vertices are rounded: a quarter of a millimetre halves a recording."""


def faces_by_band(
    faces: NDArray[np.uint32], values_m: NDArray[np.floating], full_m: float
) -> list[NDArray[np.uint32]]:
    """The faces (F, 3) of a mesh in bands of equal width of its values (V,), from 0 to `full_m`."""
    first, second, third = values_m[faces.T]
    of_face = (first + second + third) / 3
    band = np.minimum((of_face * (BANDS / full_m)).astype(np.int64), BANDS - 1)
    order = np.argsort(band, kind="stable")
    ends = np.cumsum(np.bincount(band, minlength=BANDS))[:-1]
    return np.split(faces[order], ends)


def own_vertices(
    faces: NDArray[np.uint32], count: int
) -> tuple[NDArray[np.intp], NDArray[np.uint32]]:
    """Which of `count` vertices faces (F, 3) have, ascending, and the same faces among those."""
    used = np.zeros(count, bool)
    used[faces] = True
    places = np.cumsum(used, dtype=np.uint32) - np.uint32(1)
    return np.flatnonzero(used), places[faces]


class Figure:
    """One body of faces (F, 3): a mesh for each band of colour, and one without colours.

    `sparse` says whether a band's mesh has no vertices but its own: less to send and to draw, but
    others every time, so that a recording, which keeps once what meshes share, grows.
    """

    def __init__(
        self, scene: viser.SceneApi, name: str, faces: NDArray[np.uint32], *, sparse: bool
    ) -> None:
        self._faces, self._sparse = faces, sparse
        self.root = scene.add_frame(f"/bodies/{name}", show_axes=False)
        self.vertices_m = np.zeros((int(faces.max()) + 1, 3), np.float32)
        """(V, 3) what is shown, about the body's own place."""

        def mesh(part: str, colour: tuple[int, int, int], opacity: float | None = None):
            path, start = f"/bodies/{name}/{part}", self.vertices_m
            return scene.add_mesh_simple(
                path, start, faces, color=colour, opacity=opacity, visible=False
            )

        self.bands = [mesh(f"band{number}", COLOURS[number]) for number in range(BANDS)]
        self._clay = mesh("clay", CLAY)
        self._ghost = mesh("ghost", CLAY, _SEE_THROUGH)
        self._label = scene.add_label(
            f"/bodies/{name}/label", name, anchor="bottom-center", font_screen_scale=0.9
        )

    def show(self, posed: Posed, full_m: float, ghost: bool, label: str, label_m: NDArray) -> None:
        """Show one frame; as a ghost one looks through it and it has no colours."""
        vertices_m = np.round(posed.vertices_m / _GRID_M).astype(np.float32) * np.float32(_GRID_M)
        self.vertices_m = vertices_m
        plain, none = posed.values_m is None and not ghost, self._faces[:0]
        by_band = [none] * BANDS
        if posed.values_m is not None and not ghost:
            by_band = faces_by_band(self._faces, posed.values_m, full_m)
        for mesh, faces in (
            *zip(self.bands, by_band, strict=True),
            (self._clay, self._faces if plain else none),
            (self._ghost, self._faces if ghost else none),
        ):
            if len(faces) and self._sparse:
                own, among_own = own_vertices(faces, len(vertices_m))
                mesh.vertices, mesh.faces = vertices_m[own], among_own
            elif len(faces):
                mesh.vertices, mesh.faces = vertices_m, faces
            mesh.visible = bool(len(faces))
        self._label.text, self._label.position = label, label_m


class LiveScene:
    """What is drawn of a selection.

    `origin`, `synthetic` or `licensed`, stands in the scene, so that every picture of it says so;
    `sparse` (see `Figure`) is False for what is recorded.
    """

    def __init__(
        self, server: viser.ViserServer, faces: NDArray, origin: str, *, sparse: bool = True
    ) -> None:
        self._server, self._faces, self._origin = server, faces.astype(np.uint32), origin
        self._sparse = sparse
        self.figures: dict[str, Figure] = {}
        scene = server.scene
        scene.set_up_direction("+y")
        scene.add_grid("/floor", 20.0, 20.0, plane="xz", cell_size=0.5, section_size=1.0)
        server.initial_camera.up = (0.0, 1.0, 0.0)
        server.initial_camera.fov = np.radians(_FIELD_OF_VIEW_DEG)
        self._shadows = True
        self._legend: tuple[object, ...] | None = None
        self._scale: list[viser.SceneNodeHandle] = []

    def frame_bodies(self, count: int) -> None:
        """Have new clients see that many bodies side by side, and the window under them."""
        camera, away_m = self._server.initial_camera, 2.6 + 1.2 * count
        camera.position, camera.look_at = (-0.3, 1.0, away_m), (-0.3, 0.4, 0.0)

    def draw(self, bodies: Sequence[Posed], selection: Selection) -> None:
        """Draw one frame of all bodies; clients see all of it at once."""
        with self._server.atomic():
            if selection.shadows != self._shadows:
                self._shadows = selection.shadows
                self._server.scene.configure_default_lights(cast_shadow=self._shadows)
            self._draw_legend(selection, len(bodies))
            for name, figure in self.figures.items():
                figure.root.visible = name in {one.name for one in bodies}
            for number, posed in enumerate(bodies):
                self._draw_body(posed, number, len(bodies), selection)

    def _draw_body(self, posed: Posed, number: int, count: int, selection: Selection) -> None:
        if posed.name not in self.figures:
            self.figures[posed.name] = Figure(
                self._server.scene, posed.name, self._faces, sparse=self._sparse
            )
        figure, overlaid = self.figures[posed.name], selection.layout == OVERLAID
        left_m = 0.0 if overlaid else _APART_M * (number - (count - 1) / 2)
        figure.root.position = (left_m, 0.0, 0.0)
        low, high = posed.vertices_m.min(axis=0), posed.vertices_m.max(axis=0)
        top_m = (low + high) / 2
        top_m[1] = high[1] + 0.1 + (0.1 * number if overlaid else 0.0)
        label = f"{posed.label} ({self._origin})" if number == 0 else posed.label
        figure.show(posed, selection.full_cm / 100, overlaid and number > 0, label, top_m)

    def _draw_legend(self, selection: Selection, count: int) -> None:
        """The colours and their scale beside the first body, drawn again where they changed."""
        wanted = selection.colouring, selection.full_cm, selection.layout, count
        if wanted == self._legend:
            return
        self._legend = wanted
        for handle in self._scale:
            handle.remove()
        self._scale = []
        if selection.colouring == PLAIN or not count:
            return
        apart = 0 if selection.layout == OVERLAID else count - 1
        left_m, scene = -0.9 - _APART_M * apart / 2, self._server.scene
        for band, colour in enumerate(COLOURS):
            at, size = (left_m, 0.2 + 0.12 * band, 0.0), (0.1, 0.12, 0.01)
            self._scale.append(
                scene.add_box(f"/scale/{band}", color=colour, dimensions=size, position=at)
            )
        full_cm = selection.full_cm
        marks = {0: "0 cm", BANDS // 2: f"{full_cm / 2:g} cm", BANDS: f"{full_cm:g} cm and more"}
        for band, text in marks.items():
            at = (left_m - 0.12, 0.14 + 0.12 * band, 0.0)
            self._scale.append(
                scene.add_label(f"/scale/mark{band}", text, position=at, anchor="center-right")
            )
        title = f"{selection.colouring} ({self._origin} data)"
        at = (left_m, 0.2 + 0.12 * (BANDS + 1), 0.0)
        label = scene.add_label("/scale/title", title, position=at, anchor="bottom-center")
        self._scale.append(label)
