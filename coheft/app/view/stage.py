"""The scene in the browser: payload, robots, wrenches, one robot's estimate, and links."""

from collections.abc import Callable
from typing import Any

import numpy as np
import trimesh
import viser

from coheft.app.view import colours, words
from coheft.app.view.arms import Arms
from coheft.app.view.geometry import (
    FOV,
    box_edges,
    ellipsoid,
    equivalent_box,
    extent,
    payload_boxes,
    place_under_ray,
    stands,
    surface_of,
    whole_team,
)
from coheft.app.view.model import ViewModel
from coheft.estimation.geometry.spatial import Array, Pose, quaternion_from_rotation, rotation_from_quaternion
from coheft.estimation.measurement import WRENCH
from coheft.estimation.rigid_body.mass_properties import Inertia
from coheft.wire.messages.structs import Estimate
from coheft.wire.messages.truth import LoadState, Scene, Truth
from coheft.wire.scenario.section import Vector, pose_of

_NO_LINES = np.zeros((1, 2, 3))
_FORCE_LENGTH = 0.15
"""Length of the arrow of a robot's share of the weight, relative to the payload's extent."""
_LONGEST = 1.0  # arrow, relative to the extent
_ARC_POINTS = 16
_EDGE = (148, 163, 184)
_SHARP = np.radians(25.0)
"""Smallest angle between two triangles with a visible edge [rad]."""


class Stage:
    """Draws a view model with viser, which sends only what has changed."""

    def __init__(self, server: viser.ViserServer, model: ViewModel) -> None:
        self._scene = server.scene
        self._size = extent(model.scene)
        self._home = Pose(np.eye(3), np.array(model.scene.home))
        self._translations = model.scene.translations
        self._rotations = model.scene.rotations
        self._index = {name: index for index, name in enumerate(model.scene.robots)}
        self.surface = surface_of(model.scene)
        self._loads: dict[int, list[Any]] = {}
        self._newton: float | None = None
        self.doubt_scale = 10.0
        self._set_up(server)
        self._arms = Arms(server.scene, model.scene)
        self._add_payload(model.scene)
        self._add_beliefs()
        self._add_network(model)
        self._move(self._home)

    def _set_up(self, server: viser.ViserServer) -> None:
        size, home = self._size, self._home.translation
        server.scene.set_up_direction("+z")
        # No shadows: hardly visible on dark ground, and slow without a GPU. Little light, or colours become white.
        server.scene.configure_default_lights(enabled=False)
        server.scene.configure_environment_map("studio", environment_intensity=0.25)
        server.scene.add_light_directional("/light", intensity=0.8, position=(1.0, -1.5, 3.0))
        middle = home + self._translations.mean(axis=0) + np.array([0.0, 0.0, -0.5 * size])
        camera = server.initial_camera
        camera.look_at, camera.position = whole_team(middle, size, 1.0)
        camera.fov = FOV

        server.on_client_connect(lambda client: show_whole_team(client.camera, middle, size))

        server.scene.add_grid(
            "/ground",
            infinite_grid=True,
            cell_size=0.25,
            section_size=1.0,
            cell_color=(45, 55, 72),
            section_color=(71, 85, 105),
            fade_distance=14.0 * size,
        )

    def _add_body(self, scene: Scene) -> list[Any]:
        """Draw the payload; return the handles that can be clicked."""
        if len(scene.triangles):
            faces = np.arange(3 * len(self.surface)).reshape(-1, 3)
            surface = trimesh.Trimesh(self.surface.reshape(-1, 3), faces)  # merges equal vertices
            sharp = surface.face_adjacency_edges[surface.face_adjacency_angles > _SHARP]
            self._lines("/payload/edges", surface.vertices[sharp] if len(sharp) else _NO_LINES, _EDGE, 1.2)
            return [
                self._scene.add_mesh_simple(
                    "/payload/surface",
                    surface.vertices,
                    surface.faces,
                    color=colours.PAYLOAD,
                    opacity=0.6,
                    flat_shading=True,
                    side="double",
                )
            ]
        bodies, edges = [], []
        for index, box in enumerate(payload_boxes(scene)):
            pose = pose_of(box.position, box.rotation_deg)
            edges.append(box_edges(pose, np.array(box.size)))
            bodies.append(
                self._scene.add_box(
                    f"/payload/boxes/{index}",
                    color=colours.PAYLOAD,
                    dimensions=box.size,
                    opacity=0.42,
                    wxyz=quaternion_from_rotation(pose.rotation),
                    position=pose.translation,
                )
            )
        self._lines("/payload/edges", np.concatenate(edges), _EDGE, 1.2)
        return bodies

    def _add_payload(self, scene: Scene) -> None:
        size = self._size
        self._frame = self._scene.add_frame("/payload", show_axes=False)
        self._bodies = self._add_body(scene)
        self._scene.add_batched_axes(
            "/payload/grasps",
            np.array([quaternion_from_rotation(rotation) for rotation in self._rotations]),
            self._translations,
            axes_length=0.16 * size,
            axes_radius=0.007 * size,
        )
        self._place = self._lines("/payload/place", _NO_LINES, colours.LOAD, 1.5)
        self._forces = self._add_arrows("/payload/forces", colours.FORCE)
        self._torques = self._add_arrows("/payload/torques", colours.TORQUE)

    def _add_arrows(self, name: str, colour: colours.Colour) -> Any:
        size = self._size
        points = np.zeros((len(self._translations), 2, 3))
        return self._scene.add_arrows(
            name,
            points,
            colour,
            shaft_radius=0.012 * size,
            head_radius=0.032 * size,
            head_length=0.08 * size,
        )

    def _add_beliefs(self) -> None:
        size = self._size
        self._true_com = self._scene.add_icosphere("/payload/truth/com", 0.03 * size, colours.TRUTH)
        self._true_box = self._lines("/payload/truth/box", _NO_LINES, colours.TRUTH, 1.5)
        self._doubt = self._scene.add_icosphere("/payload/belief/doubt", 1.0, colours.ACCENT, opacity=0.65)
        self._cross = self._lines("/payload/belief/com", _NO_LINES, colours.ACCENT, 3.0)
        self._belief_box = self._lines("/payload/belief/box", _NO_LINES, colours.ACCENT, 3.0)
        self._doubt.visible = self._cross.visible = self._belief_box.visible = False

    def _add_network(self, model: ViewModel) -> None:
        shoulders = {name: stand.shoulder for name, stand in zip(model.scene.robots, stands(model.scene), strict=True)}
        self._links = {}
        for edge in model.edges:
            start, end = (shoulders[name] for name in edge)
            share = np.linspace(0.0, 1.0, _ARC_POINTS)[:, None]
            rise = 0.18 * float(np.linalg.norm(end - start)) * (1.0 - (2.0 * share - 1.0) ** 2)
            arc = (1.0 - share) * start + share * end - rise * np.array([0.0, 0.0, 1.0])
            lines = np.stack([arc[:-1], arc[1:]], axis=1)
            self._links[edge] = self._lines(f"/network/{edge[0]}-{edge[1]}", lines, colours.WAITING, 3.0)

    def _lines(self, name: str, points: Array, colour: colours.Colour, thickness: float) -> Any:
        return self._scene.add_line_segments(name, points, colour, thickness=thickness, thickness_units="screen")

    def draw(self, model: ViewModel, chosen: str) -> None:
        """Draw the present state; ``chosen`` is the robot whose estimate is shown."""
        truth = model.record.truth
        if truth is not None:
            self._move(Pose(rotation_from_quaternion(truth.quaternion), truth.position))
            self._draw_wrenches(truth)
            payload = Inertia(truth.payload.mass, truth.payload.com, truth.payload.tensor)
            self._true_com.position = payload.com
            self._true_box.points = box_edges(*equivalent_box(payload))
        self._draw_loads(model.loads)
        self._draw_belief(model.believed_payload(chosen), model.record.beliefs.get(chosen))
        self._arms.paint(model, chosen)
        for edge, lines in self._links.items():
            lines.colors = np.array(colours.LINK[model.link(edge)], dtype=np.uint8)

    def _move(self, payload: Pose) -> None:
        """Move the payload and the arms that hold it to its pose in the world."""
        self._payload = payload
        self._frame.position = payload.translation
        self._frame.wxyz = quaternion_from_rotation(payload.rotation)
        self._arms.reach(payload.apply(self._translations))

    def _draw_wrenches(self, truth: Truth) -> None:
        if self._newton is None:
            share = 9.81 * truth.payload.mass / len(self._translations)
            self._newton = _FORCE_LENGTH * self._size / share
        for arrows, part, scale in (
            (self._forces, slice(0, 3), self._newton),
            (self._torques, slice(3, 6), self._newton / self._size),
        ):
            ways = scale * np.einsum("nij,nj->ni", self._rotations, truth.samples[:, WRENCH][:, part])
            lengths = np.linalg.norm(ways, axis=1, keepdims=True)
            ways *= np.minimum(1.0, _LONGEST * self._size / np.maximum(lengths, 1e-9))
            arrows.points = np.stack([self._translations, self._translations + ways], axis=1)

    def _draw_loads(self, loads: list[LoadState]) -> None:
        there = {load.id: load for load in loads}
        for number in [number for number in self._loads if number not in there]:
            for handle in self._loads.pop(number):
                handle.remove()
        for number, load in there.items():
            if number not in self._loads:
                self._loads[number] = self._add_load(load)
            _, label = self._loads[number]
            label.text = words.load(load)

    def _add_load(self, load: LoadState) -> list[Any]:
        box = self._scene.add_box(
            f"/payload/loads/{load.id}", color=colours.LOAD, dimensions=load.size, position=load.position
        )
        above = np.array(load.position) + [0.0, 0.0, 0.5 * load.size[2] + 0.06 * self._size]
        label = self._scene.add_label(
            f"/payload/loads/{load.id}_label", words.load(load), position=above, anchor="bottom-center"
        )
        return [box, label]

    def _draw_belief(self, believed: Inertia | None, estimate: Estimate | None) -> None:
        for handle in (self._doubt, self._cross, self._belief_box):
            handle.visible = believed is not None
        if believed is None or estimate is None or estimate.payload is None:
            return
        rotation = self._rotations[self._index[estimate.robot]]
        pose, half = ellipsoid(believed.com, rotation @ estimate.payload.covariance[1:4, 1:4] @ rotation.T)
        self._doubt.position, self._doubt.wxyz = pose.translation, quaternion_from_rotation(pose.rotation)
        self._doubt.scale = tuple(np.clip(self.doubt_scale * half, 1e-4, 4.0 * self._size).tolist())
        arm = 0.08 * self._size * np.eye(3)
        self._cross.points = np.stack([believed.com - arm, believed.com + arm], axis=1)
        self._belief_box.points = box_edges(*equivalent_box(believed))

    def on_payload_click(self, act: Callable[[Array], None]) -> None:
        """Call ``act`` with the position of each click on the payload, (3,) in its frame [m]."""

        def clicked(event: Any) -> None:
            pose = self._payload.inverse()
            hit = place_under_ray(
                self.surface, pose.apply(event.ray_origin), pose.rotation @ np.array(event.ray_direction)
            )
            if hit is not None:
                act(hit)

        for body in self._bodies:
            body.on_click(clicked)

    def show_place(self, place: Vector, edge: float) -> None:
        """Show the place of the next load: centre in the payload's frame and edge length [m]."""
        self._place.points = box_edges(Pose(np.eye(3), np.array(place)), np.full(3, edge))


def show_whole_team(camera: viser.CameraHandle, middle: Array, size: float) -> None:
    """Let a browser show all robots, also in a narrow window; arguments as for ``whole_team``."""
    first = whole_team(middle, size, 1.0)[1]

    def show() -> None:
        look_at, camera.position = whole_team(middle, size, camera.aspect)
        camera.look_at = look_at  # which its position has moved along

    show()

    @camera.on_update
    def _(_: object) -> None:
        if np.allclose(camera.position, first, atol=1e-3 * size):  # it has taken the server's first camera after ours
            show()
