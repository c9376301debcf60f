"""Options that several commands share: keys of the job file, and the page in a browser."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

from cyclopts import Parameter

from tjscan.core.errors import ConfigurationError, explain_missing_package

if TYPE_CHECKING:
    from tjscan.live.page import PageAddress

HIGHEST_PORT: Final = 65_535


@Parameter(name="*")
@dataclass(frozen=True, slots=True, kw_only=True)
class PageOptions:
    """Where the page is served.

    Parameters
    ----------
    port
        Port of the page in the browser; 0 for any that is free.
    address
        Address of this machine that the page is bound to. Anyone who has the printed address of a
        page with buttons moves machines by it: leave it at 127.0.0.1 unless the network is
        trusted.
    """

    port: int = 8080
    address: str = "127.0.0.1"

    @property
    def page_address(self) -> PageAddress:
        """Address and port of the page, once viser is found to be installed.

        Raises
        ------
        ConfigurationError
            If it is not installed, or there is no such port.
        """
        if not 0 <= self.port <= HIGHEST_PORT:
            raise ConfigurationError(f"--port is 0 to {HIGHEST_PORT}")
        with explain_missing_package("the page", "live"):
            from tjscan.live.page import PageAddress
        return PageAddress(port=self.port, address=self.address)


@Parameter(name="*")
@dataclass(frozen=True, slots=True, kw_only=True)
class LiveOptions(PageOptions):
    """Whether and where a run is shown in a browser while it goes on.

    Parameters
    ----------
    live
        Show the run in a browser while it goes on, with buttons that stop it.
    """

    port: Annotated[
        int, Parameter(help="With --live: port of the page; 0 for any that is free.")
    ] = 8080
    address: Annotated[
        str,
        Parameter(
            help="With --live: address of this machine that the page is bound to. Anyone who has "
            "the page's whole address moves machines by it: leave it at 127.0.0.1 unless the "
            "network is trusted."
        ),
    ] = "127.0.0.1"
    live: bool = False

    def check_options(self) -> None:
        """Check that the options go together, and that the page's server is installed.

        Raises
        ------
        ConfigurationError
            If not.
        """
        if self.live:
            _ = self.page_address
        elif self != type(self)():
            raise ConfigurationError("--port, --address and --wait go with --live")


@Parameter(name="*")
@dataclass(frozen=True, slots=True, kw_only=True)
class ProfileNumberOptions:
    """What the numbers of a profile file mean.

    Parameters
    ----------
    units
        Unit of length, if the names of the columns do not state it. Left out, the one in which the
        profiles are as wide as a line laser's is assumed.
    pitch
        Distance of the columns of a matrix, or of points without an x, in that unit.
    invalid
        A value that means no point, beside NaN, an empty cell, and 0 if it is far from all other
        heights.
    z_scale
        What one of the heights' numbers is in that unit; 1. Negative where heights grow towards
        the sensor.
    """

    units: Literal["mm", "um", "m"] | None = None
    pitch: float | None = None
    invalid: list[float] | None = None
    z_scale: float = 1.0


@Parameter(name="*")
@dataclass(frozen=True, slots=True, kw_only=True)
class ProfileFileOptions(ProfileNumberOptions):
    """How the numbers of a profile file are read.

    Parameters
    ----------
    z_offset
        Distance from the sensor, in that unit, where the file's height is 0. If left out,
        heights of either sign count from a mid-range 240 mm from the sensor.
    """

    z_offset: float | None = None


@Parameter(name="*")
@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedOptions(ProfileNumberOptions):
    """A recording of one target, without a job.

    Parameters
    ----------
    target
        What recorded profiles show; or points on the flange, each with its joint angles, as a laser
        tracker has them: with --arm.
    radius_mm
        Radius of a ball; found if left out.
    touched
        File of points touched on a plane.
    poses
        File of the flange's poses, if there are several beside the profiles.
    """

    target: Literal["ball", "roof", "plane", "points"] | None = None
    radius_mm: float | None = None
    touched: Path | None = None
    poses: Path | None = None

    @property
    def stated(self) -> dict[str, Any]:
        """Those that were stated, as keys of a table [[recorded]]."""
        own = {k: v for k, v in asdict(self).items() if v != getattr(RecordedOptions(), k)}
        return {k: str(v) if isinstance(v, Path) else v for k, v in own.items()}


@Parameter(name="*")
@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrationMode:
    """What is calibrated, and whether anything moves or is asked.

    Parameters
    ----------
    arm
        Calibrate the arm's kinematics with the sensor, on the ball that the job states, or on
        recorded profiles or points with joint angles. A scan that takes the file corrects the
        arm's poses with them.
    dry_run
        Check the job and plan its lines on the board that it states; connect, but move nothing.
    unattended
        Ask nothing; for a simulated cell.
    check
        Check this calibration.toml on recorded profiles, a few new ones; make none. Ends with 1 if
        it does not hold.
    """

    arm: bool = False
    dry_run: bool = False
    unattended: bool = False
    check: Path | None = None


@Parameter(name="*")
@dataclass(frozen=True, slots=True, kw_only=True)
class LiveScanOptions(LiveOptions):
    """Whether and where a scan is shown in a browser while it goes on.

    Parameters
    ----------
    live
        Show the scan in a browser while it goes on, with buttons that pause and stop it.
    wait
        With --live: begin when Start is pressed there.
    """

    wait: bool = False


@Parameter(name="*")
@dataclass(frozen=True, slots=True, kw_only=True)
class LiveCrawlOptions(LiveScanOptions):
    """Whether and where a crawl is shown in a browser while it goes on.

    Parameters
    ----------
    live
        Show the crawl in a browser while it goes on, with a button that stops it.
    wait
        With --live: begin when Start is pressed there; until then buttons drive while they are
        held.
    """


FILE_KEY_SUFFIXES: Final = (".file", ".recording", ".profiles", ".poses", ".touched")
"""Endings of keys whose values are files."""

JobKeys = Annotated[str, Parameter(allow_leading_hyphen=True, show=False)]
"""Type of the arguments of a command that are keys of its job: ``--scan.step-mm 20``."""


def parse_overrides(tokens: Sequence[str], method: str | None = None) -> dict[str, Any]:
    """Parse options that override keys of a job file into dotted keys and values.

    The path of a file counts from the working directory, as everywhere on a command line.

    Parameters
    ----------
    tokens : sequence of str
        The arguments as given.
    method : str, optional
        Value of the key ``method``, which has an option of its own.

    Raises
    ------
    ConfigurationError
        If a token is no dotted option, has no value, or one that begins as a list or a table and is
        none.
    """
    overrides: dict[str, Any] = {}
    rest = iter(tokens)
    for token in rest:
        option, equals, value = token.partition("=")
        if not option.startswith("--") or "." not in option:
            raise ConfigurationError(
                f"unknown option or argument {token!r}; "
                "a key of the job file is written --table.key VALUE"
            )
        text = value if equals else next(rest, None)
        if text is None:
            raise ConfigurationError(f"option {option} needs a value")
        key, found = option[2:].replace("-", "_"), _toml_value(option, text)
        is_path = key.endswith(FILE_KEY_SUFFIXES) and isinstance(found, str)
        overrides[key] = str(Path(found).absolute()) if is_path else found
    return overrides if method is None else overrides | {"method": method}


def _toml_value(option: str, text: str) -> Any:
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except (ValueError, RecursionError) as error:
        if text.lstrip().startswith(("[", "{")):
            raise ConfigurationError(
                f"option {option} has no value as TOML writes it, for instance [1, 2], or "
                f'[{{key = "word"}}] with an equals sign after each key: {error} (found {text!r})'
            ) from None
        return text  # a bare word
