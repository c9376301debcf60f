"""How a calibration answers to the laser's own deviation, as ``calibration.toml`` holds it."""

from __future__ import annotations

from typing import Annotated, Final

import numpy as np
from pydantic import Field, model_validator

from tjscan.core.config import StrictFileModel
from tjscan.core.frames import Array

_UNITS: Final = np.array((1e3, 1e3, 1e3, *np.full(3, 180 / np.pi)))
"""From metres and radians to the file's millimetres and degrees."""


class LaserResponseEntry(StrictFileModel):
    """The table [laser_response]: what the laser deviates by is in what was calibrated with it too.

    `by_draws` says by how much T_f_s, and the deviations of the arm's joints after it, are off
    with each standard normal draw of the laser's deviation, see `LaserDeviation.at`; rows in the
    order of the covariance, in mm and degrees. The covariance holds it already.
    """

    linearity_mm: float = Field(gt=0)
    by_draws: Annotated[
        tuple[Annotated[tuple[float, ...], Field(strict=False)], ...], Field(strict=False)
    ]

    @model_validator(mode="after")
    def _is_a_table(self) -> LaserResponseEntry:
        if len({len(row) for row in self.by_draws}) != 1 or len(self.by_draws) % 6:
            raise ValueError("a response has six rows a pose and joint, all of the same length")
        return self

    @classmethod
    def from_si(cls, linearity: float, by_draws: Array) -> LaserResponseEntry:
        """Make the entry from metres and radians.

        Parameters
        ----------
        linearity : float
            Largest deviation of the laser in its window, metres.
        by_draws : ndarray, shape (6 k, m)
            Metres and radians.
        """
        units = np.tile(_UNITS, len(by_draws) // 6)
        return cls(
            linearity_mm=1e3 * linearity,
            by_draws=tuple(map(tuple, (units[:, None] * by_draws).tolist())),
        )

    @property
    def by_draws_si(self) -> Array:
        """The response in metres and radians, shape (6 k, m)."""
        units = np.tile(_UNITS, len(self.by_draws) // 6)
        return np.asarray(np.array(self.by_draws) / units[:, None])
