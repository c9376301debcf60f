"""Run a loopback laser: a job's simulated laser or recorded profiles, behind GigE Vision."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import cycle
from pathlib import Path
from typing import Any

from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array
from tjscan.laser.files.format import ProfileFormat
from tjscan.laser.files.read import read_profiles
from tjscan.laser.line_laser import LineLaser
from tjscan.laser.profile import Profile
from tjscan_loopback.laser.sensor import LoopbackSensor
from tjscan_loopback.laser.server import run_laser_server
from tjscan_loopback.process import check_is_loopback_address, print_line
from tjscan_loopback.ur.pose_reader import FlangePoses


def run_loopback_laser(
    job_file: Path | None,
    overrides: dict[str, Any],
    *,
    recording: Path | None,
    host: str,
    arm: str | None,
    serial: str,
    clock: tuple[float, float] = (0.0, 0.0),
    attached: bool,
) -> None:
    """Run a loopback laser until interrupted, or until an attached stdin ends.

    It prints its events to stdout, a line each.

    Raises
    ------
    ConfigurationError
        If the address, the job or the recording can't be.
    """
    check_is_loopback_address(host)
    if job_file is not None and recording is None:
        # Loads the simulation, which a recording does without.
        from tjscan.runs.laser import prepare_simulated_laser

        carrier = None if arm is None else FlangeOfArm(FlangePoses(arm))
        T_b_f = None if carrier is None else carrier.T_b_f
        source: RecordedProfiles | SimulatedProfiles = SimulatedProfiles(
            *prepare_simulated_laser(job_file, overrides, T_b_f), carrier
        )
    elif recording is not None and job_file is None:
        source = RecordedProfiles.of_file(recording)
    else:
        raise ConfigurationError("it needs either a job or a --recording, and not both")
    sensor = LoopbackSensor(
        host, serial, source.columns, source.expose, source.begin, print_line, clock
    )
    run_laser_server(sensor, print_line, attached=attached)


class FlangeOfArm:
    """The flange of an arm behind its controller, at the moment that is asked for.

    Parameters
    ----------
    poses : FlangePoses
        Of the arm.
    """

    def __init__(self, poses: FlangePoses) -> None:
        self._poses = poses
        self._T_b_f: Array | None = None

    def go_to(self, time: float) -> bool:
        """Put it where it was at a moment of `time.monotonic`; whether that is known yet."""
        self._T_b_f = self._poses.at(time)
        return self._T_b_f is not None

    def T_b_f(self) -> Array:
        """Where it is, shape (4, 4), metres."""
        if self._T_b_f is None:
            raise RuntimeError("where the flange is, is not known yet")
        return self._T_b_f


class SimulatedProfiles:
    """Profiles of a job's simulated laser: the same ones from each start of an acquisition.

    Parameters
    ----------
    columns : int
        Points of a profile.
    make : callable
        Makes the laser, its random numbers at their beginning.
    carrier : FlangeOfArm, optional
        What carries it; it stays where it is without.
    """

    def __init__(
        self, columns: int, make: Callable[[], LineLaser], carrier: FlangeOfArm | None = None
    ) -> None:
        self.columns, self._make, self._carrier = columns, make, carrier
        self.begin()

    def begin(self) -> None:
        """Begin with the first profile again."""
        self._laser = self._make()
        self._laser.__enter__()

    def expose(self, time: float) -> Profile | None:
        """Take the next profile. See `LoopbackSensor`."""
        if self._carrier is not None and not self._carrier.go_to(time):
            return None
        return self._laser.capture()


class RecordedProfiles:
    """Profiles one after another, and from the first one again: also when an acquisition starts.

    Parameters
    ----------
    profiles : sequence of Profile
        One at least; profiles of another number of points than the first are left out.
    """

    def __init__(self, profiles: Sequence[Profile]) -> None:
        self.columns = len(profiles[0])
        self._profiles = [profile for profile in profiles if len(profile) == self.columns]
        self.begin()

    @classmethod
    def of_file(cls, file: Path) -> RecordedProfiles:
        """Profiles of a run directory, of one of its recordings, or of a file of profiles.

        Raises
        ------
        ConfigurationError
            If there are none.
        """
        if file.is_dir() or file.suffix == ".mcap":
            from tjscan.scanning.recording import read_views

            profiles = [view.profile for view in read_views(file)]
        else:
            profiles = list(read_profiles(file, ProfileFormat()).profiles.values())
        if not profiles:
            raise ConfigurationError(f"there is no profile in {file}", key="recording")
        return cls(profiles)

    def begin(self) -> None:
        """Begin with the first profile again."""
        self._turn = cycle(self._profiles)

    def expose(self, time: float) -> Profile:
        """Take the next profile, whenever."""
        return next(self._turn)
