"""Clicks, boxes and brush strokes on the object: what they select."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from mam_sim.studio.picking import (
    Camera,
    area_around,
    face_under,
    faces_in_box,
    faces_near,
    primitives_in_box,
)
from mam_sim.studio.workspace import Workspace


class Pointer:
    """Selects whole pieces or single faces, as `Workspace.picks` says."""

    def __init__(self, work: Workspace) -> None:
        """Listen to the view: clicks select, with Shift more; Shift and drag is a box."""
        self.work = work
        scene, guarded = work.server.scene, work.guarded

        def click(event: Any) -> None:
            self._click(event, more=False)

        def click_more(event: Any) -> None:
            self._click(event, more=True)

        scene.on_click()(guarded(click))
        scene.on_click(modifier="shift")(guarded(click_more))
        scene.on_rect_select(modifier="shift")(guarded(self._box))
        work.scene.on_stroke = guarded(self._stroke)

    def _click(self, event: Any, more: bool) -> None:
        work = self.work
        if work.pointing is not None:
            work.pointing.click(event)
            return
        tracer = work.tracer()[1]
        found = face_under(tracer, np.asarray(event.ray_origin), np.asarray(event.ray_direction))
        work.bad, work.face = (), None
        if not more:
            work.select_nothing()
        if found is None:
            work.choose(work.part if more else "")
            return
        face, at = found
        work.clicked(face, at, np.asarray(event.ray_direction))
        if work.picks == "pieces":
            work.selected ^= {int(work.open.primitives.labels[face])}
        else:
            area = self._faces(face)
            work.brushed = work.brushed - area if face in work.brushed else work.brushed | area
        work.choose(work.open.link_of_face(face).name)

    def _faces(self, face: int) -> set[int]:
        """What a click or a point of a stroke takes, of the piece that was hit."""
        work = self.work
        mesh = work.open.mesh
        own = np.flatnonzero(work.open.primitives.labels == work.open.primitives.labels[face])
        if work.picks == "areas":
            return set(area_around(mesh, own, face).tolist())
        return set(faces_near(mesh, own, face, work.at, work.brush * mesh.diagonal).tolist())

    def _stroke(self, event: Any) -> None:
        """Paint faces while the pointer is drawn over the object."""
        work, camera = self.work, camera_of(event.client)
        if work.picks != "brush":
            return
        ray = camera.rays(np.asarray(event.end_screen_pos)[None])[0]
        found = face_under(work.tracer()[1], camera.position, ray)
        if found is None:
            return
        work.clicked(*found, ray)
        before = len(work.brushed)
        work.brushed |= self._faces(found[0])
        if len(work.brushed) > before:
            work.mark()
        if event.phase == "end":
            work.choose(work.open.link_of_face(found[0]).name)

    def _box(self, event: Any) -> None:
        work, seen = self.work, camera_of(event.client)
        mesh, tracer = work.tracer()
        low, high = np.asarray(event.screen_min), np.asarray(event.screen_max)
        if work.picks == "pieces":
            labels = work.open.primitives.labels
            work.selected |= set(primitives_in_box(mesh, labels, tracer, seen, low, high))
        else:
            work.brushed |= set(faces_in_box(mesh, tracer, seen, low, high).tolist())
        work.choose(work.part)


def camera_of(client: Any) -> Camera:
    """The camera of a window."""
    camera = client.camera
    turn = Rotation.from_quat(np.roll(camera.wxyz, -1)).as_matrix()
    return Camera(np.asarray(camera.position), turn, camera.fov, camera.aspect)
