"""A run's groove beside the WPS's table of joint details."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tjscan.core.errors import ConfigurationError, TubesNotFound
from tjscan.groove.measured import MeasuredSection
from tjscan.joint.tubes.find import find_tubes_in_cloud
from tjscan.joint.tubes.fit import dihedral_angles, dihedral_sigmas
from tjscan.planning.details import DetailStretch, compare_with_details
from tjscan.planning.edges import GrooveEdges
from tjscan.planning.wps import WeldingProcedure
from tjscan.result.directory import CLOUD
from tjscan.result.shapes import read_run_shape


def details_of_run(
    directory: Path,
    sections: Sequence[MeasuredSection],
    edges: GrooveEdges,
    wps: WeldingProcedure,
) -> tuple[DetailStretch, ...]:
    """Compare a run's groove with the WPS's table, by the tubes fitted to its cloud.

    Parameters
    ----------
    directory : Path
        The run directory.
    sections : sequence of MeasuredSection
        In their order along the groove.
    edges : GrooveEdges
        Smoothed through them.
    wps : WeldingProcedure
        Without a table, nothing is compared and no tube sought.

    Raises
    ------
    ConfigurationError
        If its cloud shows no tubes.
    """
    if not wps.detail:
        return ()
    shape = read_run_shape(directory)
    try:
        tubes = find_tubes_in_cloud(np.empty((0, 3)) if shape.points is None else shape.points)
    except TubesNotFound as error:
        raise ConfigurationError(
            f"the local dihedral angle is not known, since leg and brace were not found: {error}. "
            "Leave out [[detail]] to plan without",
            file=directory / CLOUD,
        ) from None
    origins = np.array([section.T_r_g[:3, 3] for section in sections])
    return compare_with_details(
        edges,
        dihedral_angles(tubes.brace, tubes.leg, origins),
        dihedral_sigmas(tubes, origins),
        wps.detail,
    )
