"""How what carries a simulated arm sways: damped modes, driven by the arm's motion and by wind.

A mode's displacement x fulfils ``mass (x'' + 2 d w x' + w² x) = -twist . dh/dt``, with h the arm's
momentum, whose change is what the arm pushes its base with. Weight is left out: a carrier that
bends under the arm bends at rest, too. So is what the sway does to the arm's motion.
"""

from __future__ import annotations

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from tjscan.core import pose_vector
from tjscan.core.frames import Array
from tjscan.robot.settings import SwaySettings


class SimulatedSway:
    """The sway of a simulated arm's base; its steps are exact, however long they are.

    Each mode is one complex number z with ``z' = r z + force / mass``, r the mode's pole; then x
    is ``imag(z) / imag(r)``.

    Parameters
    ----------
    settings : SwaySettings
        The modes, n of them.
    random : numpy.random.Generator
        Source of the gusts.
    """

    def __init__(self, settings: SwaySettings, random: Generator) -> None:
        modes, self.payload = settings.mode, settings.payload
        self._twists = np.array([mode.twist for mode in modes])
        self._mass = np.array([mode.mass for mode in modes])
        w = 2 * np.pi * np.array([mode.frequency for mode in modes])
        damping = np.array([mode.damping for mode in modes])
        self._pole = w * (-damping + 1j * np.sqrt(1 - damping**2))
        # White noise of this intensity keeps up a displacement of variance wind².
        self._gusts = 4 * damping * w**3 * np.array([mode.wind for mode in modes]) ** 2
        self._random = random
        self._z = np.zeros(len(modes), dtype=complex)
        self._momentum = np.zeros(len(modes))

    @property
    def displacements(self) -> Array:
        """Of each mode, shape (n,), metres at the base's origin."""
        return np.asarray(self._z.imag / self._pole.imag)

    @property
    def T_rest_b(self) -> Array:
        """Pose of the swaying base where it would be at rest, shape (4, 4)."""
        return pose_vector.pose_from_vector(self.displacements @ self._twists)

    def advance(self, seconds: float, momentum: Array | None = None) -> None:
        """Let time pass, while the arm has a momentum.

        Parameters
        ----------
        seconds : float
            How long.
        momentum : ndarray, shape (6,), optional
            As of `Kinematics.momentum`, the same all the while: it changes at the beginning. None
            of an arm at rest.
        """
        now = np.zeros(len(self._z)) if momentum is None else self._twists @ momentum
        self._z -= (now - self._momentum) / self._mass
        self._momentum = now
        self._z *= np.exp(self._pole * seconds)
        if self._gusts.any():
            self._z += self._draw_gusts(seconds)

    def _draw_gusts(self, seconds: float) -> NDArray[np.complex128]:
        """What white noise adds to each z in some time; shape (n,), complex."""
        r = self._pole
        size = self._gusts * -np.expm1(2 * r.real * seconds) / (-2 * r.real)  # of |z|²
        twice = self._gusts * np.expm1(2 * r * seconds) / (2 * r)  # of z²
        real, imag = (size + twice.real) / 2, (size - twice.real) / 2
        both = twice.imag / 2
        a, b = self._random.standard_normal((2, len(r)))
        first = np.sqrt(real)
        slope = both / np.maximum(first, 1e-300)
        drawn = slope * a + np.sqrt(np.maximum(imag - slope**2, 0.0)) * b
        return np.asarray(first * a + 1j * drawn)
