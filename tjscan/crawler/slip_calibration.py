"""``crawl-calibration.toml``: what a shuttle learned of how a vehicle slips on a hull."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import numpy as np
import tomli_w
from pydantic import Field, model_validator

from tjscan.core.config import StrictFileModel, read_toml, validate_table
from tjscan.core.errors import ConfigurationError
from tjscan.core.files import write_files_atomically
from tjscan.core.provenance import Provenance
from tjscan.crawler.slip_estimator import SlipEstimate, SlipUncertainty
from tjscan.crawler.slip_model import SlipState

LEARNED_STATES = (
    SlipState.ROTATION_CENTRE,
    SlipState.YAW_EFFICIENCY,
    SlipState.DRIFT,
    SlipState.CRAB,
    SlipState.TURNING_CRAB,
    SlipState.SETTLED_CENTRE,
)
"""What belongs to vehicle and hull, not to the vehicle's place."""

_SHOWN_STATES = (
    ("centre of rotation, ahead in travel direction", 1e3, "mm"),
    ("yaw efficiency", 1.0, ""),
    ("drift", 1e3, "mrad/m"),
    ("crab", 1e3, "mrad"),
    ("crab while turning", 1e3, "mm"),
    ("centre of rotation, farther ahead in a turn that lasts", 1e3, "mm"),
)

Row = Annotated[tuple[float, float, float, float, float, float], Field(strict=False)]


class SlipCalibration(StrictFileModel):
    """Content of the file. Quantities in their SI units, in the order of the fields.

    `covariance` belongs to the six quantities.
    """

    vehicle: str
    date: datetime
    rotation_centre_m: float
    yaw_efficiency: float = Field(gt=0, le=1.5)
    drift_rad_per_m: float
    crab_rad: float
    turning_crab_m: float
    settled_centre_m: float
    covariance: Annotated[tuple[Row, Row, Row, Row, Row, Row], Field(strict=False)]

    @model_validator(mode="after")
    def _covariance_is_one(self) -> SlipCalibration:
        covariance = np.array(self.covariance)
        if not np.allclose(covariance, covariance.T) or np.linalg.eigvalsh(covariance)[0] <= 0:
            raise ValueError("its covariance is not one: it must be symmetric and positive")
        return self

    @classmethod
    def from_estimate(cls, estimate: SlipEstimate, vehicle: str) -> SlipCalibration:
        """The slip that was estimated, for a vehicle of this id."""
        P = estimate.P[np.ix_(LEARNED_STATES, LEARNED_STATES)]
        values = estimate.x[list(LEARNED_STATES)].tolist()
        return cls(
            vehicle=vehicle,
            date=datetime.now(UTC),
            rotation_centre_m=values[0],
            yaw_efficiency=values[1],
            drift_rad_per_m=values[2],
            crab_rad=values[3],
            turning_crab_m=values[4],
            settled_centre_m=values[5],
            covariance=((P + P.T) / 2).tolist(),
        )

    @property
    def values(self) -> tuple[float, ...]:
        """The six quantities."""
        return (
            self.rotation_centre_m,
            self.yaw_efficiency,
            self.drift_rad_per_m,
            self.crab_rad,
            self.turning_crab_m,
            self.settled_centre_m,
        )

    @property
    def rows(self) -> list[tuple[str, str, str]]:
        """Name, value and standard deviation of each quantity, with units, for people."""
        sigmas = np.sqrt(np.diag(np.array(self.covariance)))
        return [
            (name, f"{scale * value:.3g} {unit}".strip(), f"{scale * sigma:.2g} {unit}".strip())
            for (name, scale, unit), value, sigma in zip(
                _SHOWN_STATES, self.values, sigmas, strict=True
            )
        ]

    def estimate_at_start(
        self, uncertainty: SlipUncertainty, curvature: float, curvature_sigma: float
    ) -> SlipEstimate:
        """What is known of slip before the first reading on a joint of this curvature, 1/m."""
        first = SlipEstimate.before_any_reading(
            uncertainty, curvature=curvature, curvature_sigma=curvature_sigma
        )
        x, P = first.x.copy(), first.P.copy()
        x[list(LEARNED_STATES)] = self.values
        P[np.ix_(LEARNED_STATES, LEARNED_STATES)] = self.covariance
        return SlipEstimate(x, P)


def write_slip_calibration(file: Path, calibration: SlipCalibration, job: str) -> None:
    """Write a calibration file; ``job`` names what it comes from."""
    head = Provenance.for_file_written_now(job, "v", "m").comment_lines("#")
    text = head + tomli_w.dumps(calibration.model_dump())
    with write_files_atomically(file.parent) as draft:
        (draft / file.name).write_text(text, encoding="utf-8")


def read_slip_calibration(file: Path, vehicle: str) -> SlipCalibration:
    """Read the calibration of a vehicle.

    Raises
    ------
    ConfigurationError
        If the file can't be read, or holds for another vehicle.
    """
    found = validate_table(SlipCalibration, read_toml(file), file)
    if found.vehicle != vehicle:
        raise ConfigurationError(
            f"holds for the vehicle {found.vehicle!r}, and the job's is {vehicle!r}: calibrate "
            "that one with tjscan crawl calibrate",
            file=file,
            key="vehicle",
        )
    return found
