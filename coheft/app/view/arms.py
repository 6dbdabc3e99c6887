"""Drawing of the robots: arms on stands, whose hands follow the payload."""

from typing import Any

import numpy as np
import trimesh
import viser

from coheft.app.view import colours
from coheft.app.view.geometry import extent, rotation_to, stands
from coheft.app.view.model import ViewModel
from coheft.estimation.geometry.spatial import Array, quaternion_from_rotation
from coheft.wire.messages.structs import Validity
from coheft.wire.messages.truth import Scene


class Arms:
    """Draws the robots with viser."""

    def __init__(self, viewer: viser.SceneApi, scene: Scene) -> None:
        self._stands = stands(scene)
        size, count = extent(scene), len(self._stands)
        base = trimesh.creation.cylinder(radius=0.15 * size, height=0.04 * size, sections=32)
        joint = trimesh.creation.icosphere(subdivisions=2, radius=0.065 * size)
        link = trimesh.creation.cylinder(radius=0.038 * size, height=1.0, sections=20)
        upright = np.tile([1.0, 0.0, 0.0, 0.0], (count, 1))
        self._shoulders = np.array([stand.shoulder for stand in self._stands])
        feet = self._shoulders * [1.0, 1.0, 0.0]
        lengths = np.array([[1.0, 1.0, stand.link] for stand in self._stands])

        def add(name: str, mesh: Any, positions: Array, colour: colours.Colour, scales: Array | None = None) -> Any:
            return viewer.add_batched_meshes_simple(
                name,
                mesh.vertices,
                mesh.faces,
                upright,
                positions,
                batched_scales=scales,
                batched_colors=np.tile(np.array(colour, dtype=np.uint8), (count, 1)),
                lod="off",
            )

        column = trimesh.creation.cylinder(radius=0.05 * size, height=1.0, sections=24)
        heights = np.column_stack([np.ones((count, 2)), self._shoulders[:, 2]])
        add("/robots/bases", base, feet + [0.0, 0.0, 0.02 * size], colours.STAND)
        add("/robots/columns", column, (self._shoulders + feet) / 2.0, colours.STAND, heights)
        add("/robots/shoulders", joint, self._shoulders, colours.JOINT)
        self._elbows = add("/robots/elbows", joint, self._shoulders, colours.JOINT)
        self._upper = add("/robots/upper_arms", link, self._shoulders, colours.ARM, lengths)
        self._fore = add("/robots/forearms", link, self._shoulders, colours.ARM, lengths)
        self._hands = add("/robots/hands", joint, self._shoulders, colours.WAITING, np.full((count, 3), 0.75))
        for name, shoulder in zip(scene.robots, self._shoulders, strict=True):
            place = shoulder - [0.0, 0.0, 0.12 * size]
            viewer.add_label(f"/robots/labels/{name}", name, position=place, anchor="center-center")

    def reach(self, hands: Array) -> None:
        """Move all hands to positions in the world, shape (N, 3) [m], and the arms with them."""
        elbows = np.array([stand.elbow(hand) for stand, hand in zip(self._stands, hands, strict=True)])
        self._elbows.batched_positions = elbows
        self._hands.batched_positions = hands
        for links, starts, ends in ((self._upper, self._shoulders, elbows), (self._fore, elbows, hands)):
            links.batched_positions = (starts + ends) / 2.0
            links.batched_wxyzs = np.array([quaternion_from_rotation(rotation_to(way)) for way in ends - starts])

    def paint(self, model: ViewModel, chosen: str) -> None:
        """Colour hands by the status of their robots' estimates, and the arm of the chosen robot."""
        names, beliefs = model.scene.robots, model.record.beliefs
        statuses = [beliefs[name].status if name in beliefs else Validity.STARTING for name in names]
        self._hands.batched_colors = np.array([colours.STATUS[status] for status in statuses], dtype=np.uint8)
        arms = [colours.ACCENT if name == chosen else colours.ARM for name in names]
        self._upper.batched_colors = self._fore.batched_colors = np.array(arms, dtype=np.uint8)
