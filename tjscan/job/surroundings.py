"""What stands about the arm: solids, the board, the joint."""

from __future__ import annotations

from typing import Annotated, Final, Literal

from pydantic import Field, model_validator

from tjscan.calibration.file import NoiseTable
from tjscan.core.config import FileModel
from tjscan.core.frames import Array
from tjscan.job.fields import Length, Lengths, PoseTable, Vector3
from tjscan.robot.solids import Box, Capsule, Cylinder, Shape, Solid

MOST: Final = 300
"""Solids of a cell: each is held against every link of the arm, at every step of a path."""

SMALLEST_BOARD_MM: Final = 100.0


class SolidTable(PoseTable):
    """A simple solid about the origin of its frame; cylinder and capsule lie along its z axis."""

    name: str = Field(min_length=1)
    kind: Literal["box", "cylinder", "capsule"]
    size_mm: Annotated[tuple[Length, Length, Length], Field(strict=False)] | None = None
    radius_mm: Length | None = None
    length_mm: Length | None = None
    euler_zyx_deg: Vector3 = (0.0, 0.0, 0.0)

    @model_validator(mode="after")
    def _has_its_sizes(self) -> SolidTable:
        is_box = self.kind == "box"
        round_sizes = (self.radius_mm, self.length_mm)
        if is_box != (self.size_mm is not None) or any(is_box != (s is None) for s in round_sizes):
            raise ValueError(
                f"a {self.kind} takes {'size_mm' if is_box else 'radius_mm and length_mm'} alone"
            )
        return self

    @property
    def solid(self) -> Solid:
        """In metres."""
        return Solid(self.name, self._shape, self.T)

    @property
    def _shape(self) -> Shape:
        if self.size_mm is not None:
            x, y, z = self.size_mm
            return Box((1e-3 * x, 1e-3 * y, 1e-3 * z))
        shape = Cylinder if self.kind == "cylinder" else Capsule
        return shape(1e-3 * (self.radius_mm or 0.0), 1e-3 * (self.length_mm or 0.0))


class StandingTable(SolidTable):
    """A solid that stands in the base frame, b, or about the workpiece, w."""

    frame: Literal["b", "w"] = "b"


class ClearanceTable(FileModel):
    """What the arm keeps clear of: `solid` stands in b or w, `tool` sits on the flange, frame f.

    The defaults are assumptions about a cell that was measured with a tape.
    """

    margin_mm: float = Field(default=10.0, ge=0, le=500)
    self_margin_mm: float = Field(default=5.0, ge=0, le=500)
    self_collision: bool = True
    smallest_singular_value: float = Field(default=0.02, ge=0, le=1)
    lifts_mm: Lengths = (50.0, 100.0, 200.0, 300.0)
    ignore: Annotated[
        tuple[Annotated[tuple[str, str], Field(strict=False)], ...], Field(strict=False)
    ] = ()
    solid: Annotated[tuple[StandingTable, ...], Field(strict=False, max_length=MOST)] = ()
    tool: Annotated[tuple[SolidTable, ...], Field(strict=False, max_length=MOST)] = ()


class BoardTable(FileModel):
    """The flat board to calibrate on: where it is about, and what to take of it.

    The frame's origin is the middle of the board's face, x along the first side, z away from it.
    """

    position_mm: Vector3
    euler_zyx_deg: Vector3
    size_mm: Annotated[tuple[float, float], Field(strict=False)]
    probe_tip_mm: Vector3
    approach_mm: float = Field(default=30.0, gt=0, le=500)
    touches: int = Field(default=9, ge=3, le=100)
    lines: int = Field(default=12, ge=5, le=100)
    noise: NoiseTable = NoiseTable()

    @model_validator(mode="after")
    def _has_a_size(self) -> BoardTable:
        if min(self.size_mm) < SMALLEST_BOARD_MM:
            raise ValueError(f"size_mm: a board is {SMALLEST_BOARD_MM:g} mm wide or wider")
        return self

    @property
    def T(self) -> Array:
        """Nominal pose of the board in the base frame, shape (4, 4), metres."""
        return PoseTable(position_mm=self.position_mm, euler_zyx_deg=self.euler_zyx_deg).T


class JointTable(FileModel):
    """The joint as designed: what the comparison measures against, and the simulated world.

    Its place is told in frame w, which is b for a job without stations. The scanner itself never
    looks at it.
    """

    file: str
    position_mm: Vector3
    euler_zyx_deg: Vector3

    @property
    def T_w_j(self) -> Array:
        """Pose of the joint in frame w, shape (4, 4), metres."""
        return PoseTable(position_mm=self.position_mm, euler_zyx_deg=self.euler_zyx_deg).T
