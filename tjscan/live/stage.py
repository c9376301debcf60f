"""The page's picture: nodes of viser's scene for what a run draws."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Final

import numpy as np
import viser
from scipy.spatial.transform import Rotation

from tjscan.core.frames import Array
from tjscan.live.colours import ARM_COLOUR, SOLID_COLOUR, TOOL_COLOUR, Colour, ColourScale
from tjscan.live.drawables import ArmPosture, BodyPose, Drawable, Lines, MeasuredPiece, Surface
from tjscan.live.step import SceneSetup
from tjscan.robot.settings import Solid
from tjscan.robot.visuals import link_meshes, solid_mesh

POINT_SIZE: Final = 0.0016
"""Metres across a drawn point."""
SOLID_OPACITY: Final = 0.16
BODY_OPACITY: Final = 0.35


class Stage:
    """The picture of one run.

    Parameters
    ----------
    server : viser.ViserServer
    setting : Setting
        What does not change is drawn at once.
    root : str
        Name of the node below which all is.
    shift : ndarray, shape (3,)
        Where frame b is in the picture, metres.
    """

    def __init__(
        self, server: viser.ViserServer, setting: SceneSetup, root: str, shift: Array
    ) -> None:
        self._scene, self._root, self._arm = server.scene, root, setting.arm
        self._scene.add_frame(root, show_axes=False, position=shift)
        self._frames: dict[str, Any] = {}
        self.nodes: dict[str, list[Any]] = {}
        """Nodes of viser's scene that each thing was drawn as, by its name."""
        self._pieces: dict[str, MeasuredPiece] = {}
        self._colour_by, self._scale = "", ColourScale(0.0, 1.0)
        self._draw_arm(setting)
        self._draw_solids("solid", setting.solids, SOLID_COLOUR, SOLID_OPACITY)
        for name, solids in setting.bodies.items():
            self._add_hidden_frame(name)
            opacity = BODY_OPACITY if name in setting.see_through else 1.0
            self._draw_solids(name, solids, ARM_COLOUR, opacity)
        for k, thing in enumerate(setting.ghost):
            self._draw_thing(f"ghost/{k}", thing)

    def draw_things(self, things: Mapping[str, Drawable]) -> None:
        """Draw things by their names; what had a name before is replaced."""
        for name, thing in things.items():
            self._draw_thing(name, thing)

    def show_only(self, names: Iterable[str]) -> None:
        """Hide what was drawn and is not named; draw nothing again."""
        wanted = set(names)
        for name, nodes in self.nodes.items():
            shown = name in wanted or name.startswith("ghost/")
            for node in nodes:
                if node.visible != shown:
                    node.visible = shown

    def colour_by(self, measure: str, scale: ColourScale) -> None:
        """Colour the measured pieces by a measure, on a scale."""
        if (measure, scale) == (self._colour_by, self._scale):
            return
        self._colour_by, self._scale = measure, scale
        for name, piece in self._pieces.items():
            colour = self._piece_colour(piece)
            for node in self.nodes[name]:
                if isinstance(node, viser.PointCloudHandle):
                    node.colors = np.array(colour, dtype=np.uint8)
                else:
                    node.color = colour

    def _draw_thing(self, name: str, thing: Drawable) -> None:
        path = f"{self._root}/{name}"
        match thing:
            case ArmPosture():
                self._pose_arm(thing.q)
            case BodyPose():
                self._place_frame(name, thing.T)
            case Lines():
                self.nodes[name] = [self._draw_lines(path, thing)]
            case Surface(vertices, triangles, colour, opacity):
                self.nodes[name] = [self._draw_mesh(path, vertices, triangles, colour, opacity)]
            case MeasuredPiece():
                self._pieces[name] = thing
                self.nodes[name] = self._draw_measured_piece(path, thing)

    def _draw_arm(self, setting: SceneSetup) -> None:
        """Links as meshes; the tool is a child of the flange."""
        if setting.arm is None:
            return
        flange = setting.arm.link_names[-1]
        for name in setting.arm.link_names:
            self._add_hidden_frame(f"arm/{name}")
        for body in link_meshes(setting.arm.urdf):
            path = f"{self._root}/arm/{body.link}/body"
            self._draw_mesh(path, body.vertices, body.triangles, ARM_COLOUR)
        self._draw_solids(f"arm/{flange}/tool", setting.tool, TOOL_COLOUR)

    def _pose_arm(self, q: Array) -> None:
        if self._arm is not None:
            for name, T in zip(self._arm.link_names, self._arm.link_poses(q), strict=True):
                self._place_frame(f"arm/{name}", T)

    def _place_frame(self, name: str, T: Array) -> None:
        if name not in self._frames:
            self._add_hidden_frame(name)
        frame = self._frames[name]
        frame.position = T[:3, 3]
        frame.wxyz = Rotation.from_matrix(T[:3, :3]).as_quat(scalar_first=True)
        if not frame.visible:
            frame.visible = True

    def _add_hidden_frame(self, name: str) -> None:
        path = f"{self._root}/{name}"
        self._frames[name] = self._scene.add_frame(path, show_axes=False, visible=False)

    def _draw_solids(
        self, name: str, solids: Iterable[Solid], colour: Colour, opacity: float = 1.0
    ) -> None:
        for k, solid in enumerate(solids):
            mesh = solid_mesh(solid)
            path = f"{self._root}/{name}/{k}"
            self._draw_mesh(path, np.asarray(mesh.vertices), mesh.faces, colour, opacity)

    def _draw_lines(self, path: str, lines: Lines) -> Any:
        middle = lines.segments.reshape(-1, 3).mean(axis=0) if lines.segments.size else np.zeros(3)
        return self._scene.add_line_segments(
            path,
            np.asarray(lines.segments - middle, dtype=np.float32),
            lines.colour,
            thickness=lines.width,
            thickness_units="screen",
            position=middle,
        )

    def _draw_mesh(
        self, path: str, vertices: Array, triangles: Any, colour: Colour, opacity: float = 1.0
    ) -> Any:
        return self._scene.add_mesh_simple(
            path,
            np.asarray(vertices, dtype=np.float32),
            np.asarray(triangles, dtype=np.uint32),
            color=colour,
            opacity=opacity if opacity < 1.0 else None,
            side="double",
            flat_shading=False,
            cast_shadow=False,
            receive_shadow=False,
        )

    def _draw_measured_piece(self, path: str, piece: MeasuredPiece) -> list[Any]:
        """Points about their own middle: half the bits are enough for a hundredth of a mm there."""
        colour, nodes = self._piece_colour(piece), list[Any]()
        points = piece.points[np.isfinite(piece.points).all(axis=1)]
        if len(points):
            middle = points.mean(axis=0)
            cloud = self._scene.add_point_cloud(
                f"{path}/points",
                points - middle,
                colour,
                point_size=POINT_SIZE,
                point_shape="circle",
                point_shading="flat",
                position=middle,
            )
            nodes.append(cloud)
        if len(piece.vertices):
            path = f"{path}/surface"
            nodes.append(self._draw_mesh(path, piece.vertices, piece.triangles, colour))
        return nodes

    def _piece_colour(self, piece: MeasuredPiece) -> Colour:
        return self._scale.colour_of(piece.values.get(self._colour_by, np.nan))
