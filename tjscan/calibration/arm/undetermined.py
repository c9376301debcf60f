"""Deviations of an arm that the profiles do not determine, and the cause of the same effect."""

from __future__ import annotations

from typing import Final

import numpy as np

from tjscan.core.frames import Array

MIN_UNDETERMINED_SHARE: Final = 0.8
"""A deviation counts as undetermined if so much of it is in directions that the profiles show less
well than the prior does."""

DEVIATION_KINDS: Final = ("length x", "length y", "length z", "twist x", "twist y", "offset")
"""Of a joint's deviations, in their order."""


def undetermined_deviations(J: Array, joints: int) -> tuple[str, ...]:
    """Sentences on deviations that profiles leave as the prior has them, by joint and cause.

    Parameters
    ----------
    J : ndarray, shape (N, 6 + 6 joints + m)
        As `whitened_jacobian` gives it: in units in which the prior of each deviation is one.
    joints : int
        Number of joints.

    Notes
    -----
    Effects that T_f_s and targets can take over are projected out. Singular values of the rest
    below one belong to combinations of deviations that the profiles show less well than the prior.
    """
    n = 6 * joints
    free = np.hstack((J[:, :6], J[:, 6 + n :]))
    Q, _ = np.linalg.qr(free / np.linalg.norm(free, axis=0))
    own = J[:, 6 : 6 + n]
    _, singular, rows = np.linalg.svd(own - Q @ (Q.T @ own), full_matrices=True)
    blind = rows[np.concatenate((singular < 1, np.ones(len(rows) - len(singular), dtype=bool)))]
    share = (blind**2).sum(axis=0)
    groups: dict[tuple[int, str], list[str]] = {}
    for k in map(int, np.flatnonzero(share >= MIN_UNDETERMINED_SHARE)):
        groups.setdefault((k // 6 + 1, _like(J, k, joints)), []).append(DEVIATION_KINDS[k % 6])
    return tuple(
        f"joint {joint}: {', '.join(kinds)} can't be told from {like}: left as the maker states"
        for (joint, like), kinds in groups.items()
    )


def _like(J: Array, k: int, joints: int) -> str:
    """Cause with most of the effect of deviation k."""
    n = 6 * joints
    others = np.delete(J, 6 + k, axis=1)
    # As few and small others as possible: the prior's weight, and next to none without a prior.
    weight = np.concatenate((np.full(6, 1e-6), np.ones(n - 1), np.full(J.shape[1] - 6 - n, 1e-6)))
    scaled = others / np.maximum(
        np.linalg.norm(others, axis=0) * (weight < 1) + (weight == 1), 1e-300
    )
    A = np.concatenate((scaled, np.diag(weight)))
    x = np.linalg.lstsq(A, np.concatenate((J[:, 6 + k], np.zeros(len(weight)))), rcond=None)[0]
    joint = np.delete(np.arange(n), k) // 6
    effect = {
        "how the sensor sits": float(np.linalg.norm(scaled[:, :6] @ x[:6])),
        "where the target is": float(np.linalg.norm(scaled[:, 5 + n :] @ x[5 + n :])),
    }
    for j in range(joints):
        at = 6 + np.flatnonzero(joint == j)
        effect[f"those of joint {j + 1}"] = float(np.linalg.norm(scaled[:, at] @ x[at]))
    return max(effect, key=lambda name: effect[name])
