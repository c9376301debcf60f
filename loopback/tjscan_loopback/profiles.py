"""Run a loopback laser: a job's simulated laser or recorded profiles, behind GigE Vision."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from itertools import cycle
from pathlib import Path
from typing import Any

from tjscan.core.errors import ConfigurationError
from tjscan.laser.files.format import ProfileFormat
from tjscan.laser.files.read import read_profiles
from tjscan.laser.line_laser import LineLaser
from tjscan.laser.profile import Profile
from tjscan_loopback.laser.sensor import LoopbackSensor
from tjscan_loopback.laser.server import run_laser_server
from tjscan_loopback.process import check_is_loopback_address, print_line
from tjscan_loopback.ur.pose_reader import read_flange_pose


def run_loopback_laser(
    job_file: Path | None,
    overrides: dict[str, Any],
    *,
    recording: Path | None,
    host: str,
    arm: str | None,
    serial: str,
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

        T_b_f = None if arm is None else partial(read_flange_pose, arm)
        source: RecordedProfiles | SimulatedProfiles = SimulatedProfiles(
            *prepare_simulated_laser(job_file, overrides, T_b_f)
        )
    elif recording is not None and job_file is None:
        source = RecordedProfiles.of_file(recording)
    else:
        raise ConfigurationError("it needs either a job or a --recording, and not both")
    sensor = LoopbackSensor(host, serial, source.columns, source.expose, source.begin, print_line)
    run_laser_server(sensor, print_line, attached=attached)


class SimulatedProfiles:
    """Profiles of a job's simulated laser: the same ones from each start of an acquisition.

    Parameters
    ----------
    columns : int
        Points of a profile.
    make : callable
        Makes the laser, its random numbers at their beginning.
    """

    def __init__(self, columns: int, make: Callable[[], LineLaser]) -> None:
        self.columns, self._make = columns, make
        self.begin()

    def begin(self) -> None:
        """Begin with the first profile again."""
        self._laser = self._make()
        self._laser.__enter__()

    def expose(self) -> Profile:
        """Take the next profile."""
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

    def expose(self) -> Profile:
        """Take the next profile."""
        return next(self._turn)
