"""Where tack welds cover the root of a joint."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tjscan.core.frames import Array
from tjscan.joint.bevel import groove_sections
from tjscan.joint.definition import JointDefinition


def tack_spans(definition: JointDefinition) -> Array:
    """First and last azimuth of each tack in radians, shape (k, 2)."""
    spans = np.empty((len(definition.imperfections.tacks), 2))
    for i, tack in enumerate(definition.imperfections.tacks):
        at = np.array([tack.at])
        land = groove_sections(definition, at).land
        speed = float(np.linalg.norm(definition.leg_surface.azimuth_derivative(at, land[:, 0])))
        spans[i] = tack.at + 0.5 * tack.length / speed * np.array((-1, 1))
    return spans


def within_spans(spans: Array, phi: ArrayLike) -> NDArray[np.bool_]:
    """Whether azimuths lie in one of the spans that `tack_spans` gives, the shape of `phi`.

    Parameters
    ----------
    spans : ndarray, shape (k, 2)
        Radians.
    phi : array_like
        Radians; a turn more or less makes no difference.
    """
    phi = np.asarray(phi, dtype=float)
    covered = np.zeros(phi.shape, dtype=bool)
    for first, last in spans:
        covered |= np.mod(phi - first, 2 * np.pi) <= last - first
    return covered
