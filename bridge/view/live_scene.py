"""Bodies, labels, the scale of colours and the floor in viser's scene."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import viser
from numpy.typing import NDArray

from bridge.view.colour_bands import (
    BANDS,
    CLAY,
    COLOURS,
    band_edges_cm,
    faces_by_band,
    own_vertices,
)
from bridge.view.selection import OVERLAID, PLAIN, Posed, Selection

_APART_M = 1.3
_SEE_THROUGH = 0.35
_FIELD_OF_VIEW_DEG = 40.0
_GRID_M = 1 / 4096
"""To which vertices are rounded: a quarter of a millimetre halves a recording."""


class Figure:
    """One body: a mesh for each band of colour, and one without colours.

    Parameters
    ----------
    faces : (F, 3).
    sparse : whether a band's mesh has no vertices but its own: less to send and to draw, but
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
        values_m = None if ghost else posed.values_m
        by_band = [self._faces[:0]] * BANDS
        if values_m is not None:
            by_band = faces_by_band(self._faces, values_m, full_m)
        plain = values_m is None
        for mesh, faces in (
            *zip(self.bands, by_band, strict=True),
            (self._clay, self._faces[: None if plain and not ghost else 0]),
            (self._ghost, self._faces[: None if ghost else 0]),
        ):
            if len(faces):
                mesh.vertices, mesh.faces = self._of(faces)
            mesh.visible = bool(len(faces))
        self._label.text, self._label.position = label, label_m

    def _of(self, faces: NDArray[np.uint32]) -> tuple[NDArray[np.float32], NDArray[np.uint32]]:
        """Vertices and faces of the mesh that shows some of the body's faces."""
        if not self._sparse:
            return self.vertices_m, faces
        own, among_own = own_vertices(faces, len(self.vertices_m))
        return self.vertices_m[own], among_own

    @property
    def visible(self) -> bool:
        """Whether the body is there at all."""
        return self.root.visible

    @visible.setter
    def visible(self, visible: bool) -> None:
        self.root.visible = visible


class LiveScene:
    """What is drawn of a selection.

    Parameters
    ----------
    faces : (F, 3) of the body.
    origin : `synthetic` or `licensed`: it stands in the scene, so that every picture of it says so.
    sparse : see `Figure`; False for what is recorded.
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
                figure.visible = name in {one.name for one in bodies}
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
        edges_cm = band_edges_cm(selection.full_cm / 100)
        for band, colour in enumerate(COLOURS):
            at = (left_m, 0.2 + 0.12 * band, 0.0)
            size = (0.1, 0.12, 0.01)
            self._scale.append(
                scene.add_box(f"/scale/{band}", color=colour, dimensions=size, position=at)
            )
        marks = {0: "0 cm", BANDS // 2: f"{edges_cm[BANDS // 2]:g} cm"}
        marks[BANDS] = f"{edges_cm[-1]:g} cm and more"
        for band, text in marks.items():
            at = (left_m - 0.12, 0.14 + 0.12 * band, 0.0)
            self._scale.append(
                scene.add_label(f"/scale/mark{band}", text, position=at, anchor="center-right")
            )
        title = f"{selection.colouring} ({self._origin} data)"
        at = (left_m, 0.2 + 0.12 * (BANDS + 1), 0.0)
        label = scene.add_label("/scale/title", title, position=at, anchor="bottom-center")
        self._scale.append(label)
