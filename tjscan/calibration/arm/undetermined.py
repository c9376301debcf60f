"""Which deviations of an arm the profiles can't show, and what they can't be told from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from tjscan.core.frames import Array

LEAST_SHARE: Final = 0.8
"""A deviation counts as undetermined if so much of it lies where the profiles say less than the
prior does."""

KINDS: Final = ("length x", "length y", "length z", "twist x", "twist y", "offset")
"""Of a joint's deviations, in their order."""


@dataclass(frozen=True, slots=True)
class UndeterminedDeviation:
    """A deviation that stays as the maker states it.

    Parameters
    ----------
    joint : int
        Number of the joint, from 1.
    kind : str
        One of `KINDS`.
    like : str
        What has the same effect on what was seen.
    """

    joint: int
    kind: str
    like: str

    def __str__(self) -> str:
        return f"joint {self.joint} {self.kind} can't be told from {self.like}"


def undetermined_deviations(J: Array, joints: int) -> tuple[UndeterminedDeviation, ...]:
    """Name the deviations that profiles leave as the prior has them.

    Parameters
    ----------
    J : ndarray, shape (N, 6 + 6 joints + m)
        As `whitened_jacobian` gives it: in units in which the prior of each deviation is one.
    joints : int
        Number of joints.

    Notes
    -----
    What T_f_s and targets can take over is projected out. Singular values below one of what is
    left belong to combinations of deviations that the profiles say less of than the prior.
    """
    n = 6 * joints
    free = np.hstack((J[:, :6], J[:, 6 + n :]))
    Q, _ = np.linalg.qr(free / np.linalg.norm(free, axis=0))
    own = J[:, 6 : 6 + n]
    _, singular, rows = np.linalg.svd(own - Q @ (Q.T @ own), full_matrices=True)
    blind = rows[np.concatenate((singular < 1, np.ones(len(rows) - len(singular), dtype=bool)))]
    share = (blind**2).sum(axis=0)
    return tuple(
        UndeterminedDeviation(k // 6 + 1, KINDS[k % 6], _like(J, k, joints))
        for k in map(int, np.flatnonzero(share >= LEAST_SHARE))
    )


def _like(J: Array, k: int, joints: int) -> str:
    """What does most of the same as deviation k."""
    n = 6 * joints
    others = np.delete(J, 6 + k, axis=1)
    # As few and as small others as do: the prior's weight, and next to none for what has no prior.
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
