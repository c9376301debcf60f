"""Run a loopback laser: a job's simulated laser or recorded profiles, behind GigE Vision."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from contextlib import suppress
from itertools import cycle
from pathlib import Path
from typing import Any

from tjscan.core.errors import ConfigurationError
from tjscan.core.loopback import check_is_loopback_address
from tjscan.laser.files.format import ProfileFormat
from tjscan.laser.files.read import read_profiles
from tjscan.laser.loopback.sensor import LoopbackSensor
from tjscan.laser.loopback.server import run_laser_server
from tjscan.laser.profile import Profile


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

    What it has to say goes to stdout, a line each.

    Raises
    ------
    ConfigurationError
        If the address, the job or the recording can't be.
    """
    check_is_loopback_address(host)
    if job_file is not None and recording is None:
        # Loads the simulation, which a recording does without.
        from tjscan.runs.simulated_profiles import SimulatedProfiles

        source: RecordedProfiles | SimulatedProfiles = SimulatedProfiles.of_job(
            job_file, overrides, arm
        )
    elif recording is not None and job_file is None:
        source = RecordedProfiles.of_file(recording)
    else:
        raise ConfigurationError("it needs either a job or a --recording, and not both")
    sensor = LoopbackSensor(host, serial, source.columns, source.expose, source.begin, _tell)
    run_laser_server(sensor, _tell, attached=attached)


class RecordedProfiles:
    """Profiles one after another, and from the first one again: also when an acquisition starts.

    Parameters
    ----------
    profiles : sequence of Profile
        One at least; those of another number of points than the first are left out.
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
            from tjscan.scanning.reader import read_views

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


def _tell(line: str) -> None:
    with suppress(BrokenPipeError):  # nobody listens any more
        sys.stdout.write(f"{line}\n")
        sys.stdout.flush()
