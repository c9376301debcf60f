"""``calibration.toml`` of a shuttle: what it learned of how a vehicle slips on a hull."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Final

import numpy as np
import tomli_w
from pydantic import Field, model_validator

from tjscan.core.config import StrictFileModel, read_toml, validate_table
from tjscan.core.errors import ConfigurationError
from tjscan.core.files import write_files_atomically
from tjscan.core.provenance import Provenance
from tjscan.crawler.slip_estimator import SlipEstimate, SlipStateIndex, SlipUncertainty

LEARNED_QUANTITIES: Final = {
    "rotation_centre_m": (
        SlipStateIndex.ROTATION_CENTRE,
        "centre of rotation, ahead in travel direction",
        1e3,
        "mm",
    ),
    "yaw_efficiency": (SlipStateIndex.YAW_EFFICIENCY, "yaw efficiency", 1.0, ""),
    "drift_rad_per_m": (SlipStateIndex.DRIFT, "drift", 1e3, "mrad/m"),
    "crab_rad": (SlipStateIndex.CRAB, "crab", 1e3, "mrad"),
    "turning_crab_m": (SlipStateIndex.TURNING_CRAB, "crab while turning", 1e3, "mm"),
    "settled_centre_m": (
        SlipStateIndex.SETTLED_CENTRE,
        "centre of rotation, farther ahead in a turn that lasts",
        1e3,
        "mm",
    ),
}
"""What belongs to vehicle and hull, not to the vehicle's place: of each field of the file its place
in the state, and its name, factor and unit for people."""

LEARNED_STATES: Final = [state for state, *_ in LEARNED_QUANTITIES.values()]

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
    def _check_covariance(self) -> SlipCalibration:
        covariance = np.array(self.covariance)
        if not np.allclose(covariance, covariance.T) or np.linalg.eigvalsh(covariance)[0] <= 0:
            raise ValueError("its covariance is not one: it must be symmetric and positive")
        return self

    @classmethod
    def from_estimate(cls, estimate: SlipEstimate, vehicle: str) -> SlipCalibration:
        """The slip that was estimated, for a vehicle of this id."""
        P = estimate.P[np.ix_(LEARNED_STATES, LEARNED_STATES)]
        values = dict(zip(LEARNED_QUANTITIES, estimate.x[LEARNED_STATES].tolist(), strict=True))
        covariance = ((P + P.T) / 2).tolist()
        return cls(vehicle=vehicle, date=datetime.now(UTC), covariance=covariance, **values)

    @property
    def values(self) -> tuple[float, ...]:
        """The six quantities."""
        return tuple(getattr(self, field) for field in LEARNED_QUANTITIES)

    @property
    def rows(self) -> list[tuple[str, str, str]]:
        """Name, value and standard deviation of each quantity, with units, for people."""
        sigmas = np.sqrt(np.diag(np.array(self.covariance)))
        return [
            (name, f"{scale * value:.3g} {unit}".strip(), f"{scale * sigma:.2g} {unit}".strip())
            for (_, name, scale, unit), value, sigma in zip(
                LEARNED_QUANTITIES.values(), self.values, sigmas, strict=True
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
        x[LEARNED_STATES] = self.values
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
