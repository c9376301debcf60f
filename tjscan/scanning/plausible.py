"""Whether a section that was read can be the one that was looked for."""

from __future__ import annotations

from typing import Final

import numpy as np

from tjscan.errors import GrooveNotFound
from tjscan.frames import Array

SHORTEST: Final = 0.3
"""Steps that a section lies ahead of the last one, at least."""

LONGEST: Final = 2.0
"""Steps that it lies ahead, at most."""

ASIDE: Final = 1.0
"""Steps that it lies aside of where the step led, at most."""


def check_step(p_b_last: Array, p_b_found: Array, direction_b: Array, step: float) -> None:
    """Refuse a section that does not lie about a step ahead of the last one.

    Believed, such a section would turn the next set-point round and lead the arm astray.

    Parameters
    ----------
    p_b_last, p_b_found : ndarray, shape (3,)
        Groove origins of the last section and of the one just read, metres.
    direction_b : ndarray, shape (3,)
        Unit vector of the step that was made.
    step : float
        Its length, metres.

    Raises
    ------
    GrooveNotFound
        With reason "implausible".
    """
    gone = p_b_found - p_b_last
    ahead = float(gone @ direction_b)
    aside = float(np.linalg.norm(gone - ahead * direction_b))
    if SHORTEST * step < ahead < LONGEST * step and aside < ASIDE * step:
        return
    raise GrooveNotFound(
        "implausible",
        f"what was read lies {1e3 * ahead:.1f} mm ahead of the last section and "
        f"{1e3 * aside:.1f} mm aside, a step of {1e3 * step:.1f} mm was made",
    )
