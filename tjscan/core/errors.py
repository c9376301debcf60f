"""The one tree of errors. Each carries its evidence and states what to do next.

Library code raises them; only the command line turns them into exit codes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike, NDArray


def _copy_evidence(values: ArrayLike) -> NDArray[np.float64]:
    """Evidence that is not changed later. The command line's help needs no NumPy."""
    import numpy as np

    return np.array(values, dtype=float)


class TjscanError(Exception):
    """Root of every error that tjscan raises on purpose."""


class ConfigurationError(TjscanError):
    """A file or an option asks for something that can't be.

    Parameters
    ----------
    message : str
        What is wrong and what would be right.
    file : Path, optional
        The file that holds it.
    key : str, optional
        The dotted key inside that file, for instance ``scan.step_mm``.
    """

    def __init__(self, message: str, *, file: Path | None = None, key: str | None = None) -> None:
        self.message, self.file, self.key = message, file, key
        where = ": ".join(str(part) for part in (file, key) if part is not None)
        super().__init__(f"{where}: {message}" if where else message)


class ArmFault(TjscanError):
    """The arm can't do, or did not do, what it was asked."""


class CarrierFault(ArmFault):
    """What carries the arm or the joint can't do, or did not do, what it was asked."""


class FlangePoseRefused(ArmFault):
    """Base of the errors about a flange pose that was asked for.

    Parameters
    ----------
    reason : str
        What is in the way, or what the controller reports, and what to do about it.
    T_b_f : array_like, shape (4, 4)
        The flange pose asked for, in the base frame.
    """

    refusal: ClassVar[str]

    def __init__(self, reason: str, T_b_f: ArrayLike) -> None:
        self.reason, self.T_b_f = reason, _copy_evidence(T_b_f)
        x, y, z = 1e3 * self.T_b_f[:3, 3]
        place = f"({x:.1f}, {y:.1f}, {z:.1f}) mm in the base frame"
        super().__init__(f"{self.refusal} {place}: {reason}")


class PoseUnreachable(FlangePoseRefused):
    """No joint configuration within limits puts the flange there."""

    refusal = "the flange can't reach"


class JointOutOfReach(TjscanError):
    """An arm can't scan a joint's groove all round, wherever it stands."""


class PathBlocked(PoseUnreachable):
    """On the way there the arm, or what it carries, would come too near to something.

    Parameters
    ----------
    reason : str
        What touches what, where along the path and by how much, and what to do about it.
    T_b_f : array_like, shape (4, 4)
        The flange pose asked for, in the base frame.
    moving, other : str
        What would touch, and what would be touched.
    share : float
        Where along the path it begins: 0 at its start, 1 at its end.
    distance : float
        The smallest on the path, in metres; below zero they overlap, about that deep.
    """

    def __init__(
        self,
        reason: str,
        T_b_f: ArrayLike,
        *,
        moving: str,
        other: str,
        share: float,
        distance: float,
    ) -> None:
        self.moving, self.other = moving, other
        self.share, self.distance = share, distance
        super().__init__(reason, T_b_f)


class ViewNotRecorded(PoseUnreachable):
    """A recording that is replayed holds no view from the pose asked for.

    Parameters
    ----------
    reason : str
        What it holds instead, and what to do about it.
    T_b_f : array_like, shape (4, 4)
        The flange pose asked for, in the base frame.
    """

    def __init__(self, reason: str, T_b_f: ArrayLike) -> None:
        super().__init__(f"the recording does not hold this view: {reason}", T_b_f)


class ArmNotConnected(ArmFault):
    """The arm's controller can't be connected to, or does not take this program's commands."""


class RegistersInUse(ArmFault):
    """Another client writes the input registers of the arm's controller already."""


class ArmBusy(ArmFault):
    """The arm's controller runs a program of another client."""


class ArmNotInRemoteMode(ArmFault):
    """The arm takes commands from its pendant alone: it is in local mode."""


class ArmNotPowered(ArmFault):
    """The arm is switched off, or its brakes are on."""


class ProtectiveStop(ArmFault):
    """The arm's safety system stopped it."""


class EmergencyStop(ArmFault):
    """An emergency stop was pressed."""


class ArmConnectionLost(ArmFault):
    """The connection to the arm's controller broke."""


class ArmNotResponding(ArmFault):
    """The arm's controller no longer answers, or shows the same state again and again."""


class TargetRefused(FlangePoseRefused):
    """The arm's controller does not go where it was sent."""

    refusal = "the controller refuses to move the flange to"


class ProgramStopped(ArmFault):
    """The arm's program for this one was stopped, by another client or the controller."""


class MoveSupervisionLost(ArmFault):
    """The arm was stopped, because this program or its computer paused while it moved."""


class PoseNotReached(ArmFault):
    """The arm reports that it has arrived, and is elsewhere.

    Parameters
    ----------
    asked, reached : array_like, shape (4, 4)
        Flange poses in the base frame.
    detail : str
        How far apart they are, and what to do about it.
    """

    def __init__(self, detail: str, asked: ArrayLike, reached: ArrayLike) -> None:
        self.asked, self.reached = _copy_evidence(asked), _copy_evidence(reached)
        super().__init__(f"the arm did not arrive where it was sent: {detail}")


class VehicleFault(TjscanError):
    """The vehicle can't do, or did not do, what it was asked."""


class VehicleLinkLost(VehicleFault):
    """Nothing is heard of the vehicle: it is not connected, or the link to it broke."""


class VehicleStopped(VehicleFault):
    """The vehicle was stopped, and takes no command until that is taken back."""

    def __init__(self) -> None:
        super().__init__(
            "the vehicle was stopped, and takes no command until that is taken back. See that the "
            "way is clear, then start again."
        )


class UnorderedMotion(VehicleFault):
    """The vehicle moves, or was stopped, as this program did not order."""


class DriveFault(VehicleFault):
    """A drive of the vehicle reports a fault, and the vehicle has stopped."""


class CrawlStopped(VehicleFault):
    """A guard stopped the crawler.

    Parameters
    ----------
    guard : str
        Which, in a word or two.
    reason : str
        What it saw, in a sentence without its full stop.
    """

    def __init__(self, guard: str, reason: str) -> None:
        self.guard, self.reason = guard, reason
        super().__init__(
            f"the crawler stopped: {reason}. See that the way is clear; --resume goes on from there"
        )


class PowerFault(TjscanError):
    """The power source can't do, or did not do, what it was asked."""


class PowerLinkLost(PowerFault):
    """The power source does not answer, or repeats the same answer."""


class WeldStopped(TjscanError):
    """A weld was stopped, with its arc out.

    Parameters
    ----------
    fault : str
        What happened, in a word or two.
    reason : str
        What was seen, in a sentence without its full stop.
    """

    def __init__(self, fault: str, reason: str) -> None:
        self.fault, self.reason = fault, reason
        super().__init__(f"the weld stopped ({fault}): {reason}")


class TowHalted(TjscanError):
    """A cable can't be towed on: there is no shape within its limits, or no pose of a vehicle."""


class LaserFault(TjscanError):
    """The line laser gave no usable profile."""


class LaserNotConnected(LaserFault):
    """No laser answers where the job has it."""


class LaserInUse(LaserFault):
    """Another program controls the laser."""


class LaserNotResponding(LaserFault):
    """The laser no longer answers, or its connection broke."""


class WrongLaser(LaserFault):
    """The laser that answers is not the one that the job, or the calibration, is for."""


class ProfileFormatRefused(LaserFault):
    """What the laser sends, or states about it, can't be turned into millimetres."""


class LaserStampsRefused(LaserFault):
    """What the laser says of when its profiles were taken can't be relied on."""


class ProfileNotReceived(LaserFault):
    """The laser answers, but none of several triggers brought a whole profile."""


class ProfileStale(LaserFault):
    """Every profile that came was exposed before it was asked for."""


class GrooveNotFound(TjscanError):
    """A profile holds no groove that can be read with confidence.

    Parameters
    ----------
    reason : str
        One of the short reasons: ``too few points``, ``no bevel``, ``ambiguous``,
        ``out of range``, ``implausible``, ``frozen``.
    detail : str
        The evidence in words, with numbers.
    points_s : array_like, shape (n, 2), optional
        The points looked at, x and z in the sensor frame, in metres.
    """

    def __init__(self, reason: str, detail: str, points_s: ArrayLike | None = None) -> None:
        self.reason, self.detail = reason, detail
        self.points_s = None if points_s is None else _copy_evidence(points_s)
        super().__init__(f"no groove found ({reason}): {detail}")


class PathNotExtended(TjscanError):
    """A path that an arm follows can't be led on: what it was given before is followed to its end.

    Parameters
    ----------
    why : str
        The reason, with numbers.
    """


class SetPointTooFar(TjscanError):
    """The set-point of the next section is further from the last one than the scan's step allows.

    Parameters
    ----------
    evidence : str
        How far, and what is allowed.
    """

    def __init__(self, evidence: str) -> None:
        super().__init__(f"the next set-point is refused: {evidence}")


class ScanInterrupted(TjscanError):
    """The operator stopped the scan, and the arm with it."""

    def __init__(self) -> None:
        super().__init__(
            "interrupted. See that the way is clear, then go on with --resume: after the last "
            "recorded section, or from the start if there is none."
        )


class StartSeesNoGroove(LaserFault):
    """The laser reads no groove from a taught pose, so the scan can't begin."""

    def __init__(self, which: str, cause: GrooveNotFound) -> None:
        self.which, self.cause = which, cause
        super().__init__(
            f"at the {which} taught pose, {cause} Move the arm until the laser line crosses "
            "brace, bevel, root and leg near the middle of its range, and teach that pose again."
        )


class StartOnTack(LaserFault):
    """A taught pose looks at a tack weld: the groove's root, where the scan starts, is buried.

    Parameters
    ----------
    which : str
        Which of the taught poses.
    """

    def __init__(self, which: str) -> None:
        self.which = which
        super().__init__(
            f"at the {which} taught pose, the laser line crosses a tack weld. Move 20 mm on along "
            "the groove and teach that pose again."
        )


class ResultRefused(TjscanError):
    """Base of the errors for a result that can't be trusted, so there is none.

    Parameters
    ----------
    reason : str
        In a few words, for instance ``too few lines`` or ``overlap too small``.
    evidence : str
        What was measured and where, with numbers, and what to do next.
    draft : object, optional
        What was known until then, to be drawn: the draft of a stitching.
    """

    subject: ClassVar[str]

    def __init__(self, reason: str, evidence: str, draft: object = None) -> None:
        self.reason, self.evidence, self.draft = reason, evidence, draft
        super().__init__(f"{self.subject} refused ({reason}): {evidence}")


class CalibrationRefused(ResultRefused):
    """A calibration can't be trusted."""

    subject = "calibration"


class AcceptanceRefused(ResultRefused):
    """A cell's acceptance can't be finished."""

    subject = "acceptance"


class LookRefused(ResultRefused):
    """A look at a partly welded groove can't be one at this weld, as it is now."""

    subject = "look"


class JointMoved(LaserFault):
    """The workpiece (the tubular joint), or the arm's base, is not where it was."""

    def __init__(self, evidence: str) -> None:
        self.evidence = evidence
        super().__init__(
            f"{evidence}. If joint or arm was moved, what was scanned before does not fit what "
            "would follow: start a new scan."
        )


class ComparisonRefused(TjscanError):
    """What was measured can't be brought onto its reference with confidence."""


class TubesNotFound(TjscanError):
    """Points do not hold the two tubes of a joint."""


class StitchingRefused(ResultRefused):
    """Stations can't be stitched with confidence."""

    subject = "stitching"


class ComputeClusterFault(TjscanError):
    """A cluster can't run a study, or can't any more; what is done of it is kept."""


class RecordingError(TjscanError):
    """A run directory or a recording can't be written or read."""


class PageUnavailable(TjscanError):
    """The live page can't be shown; a run goes on without it."""


def message_with_notes(error: BaseException) -> str:
    """Message of an error and the notes added to it, as one text."""
    sentences = (str(error), *getattr(error, "__notes__", ()))
    return ". ".join(words.removesuffix(".") for words in sentences)


def nearest_word(word: str, known: Sequence[str]) -> str:
    """Return the known word that looks most like `word`, or a list of all of them if none does.

    Parameters
    ----------
    word : str
        What was given.
    known : sequence of str
        What is allowed.
    """
    from difflib import get_close_matches

    close = get_close_matches(word, known, n=1, cutoff=0.5)
    return close[0] if close else ", ".join(sorted(known))


def missing_package_error(
    what: str, package: str, extra: str | None, key: str | None = None
) -> ConfigurationError:
    """Error that names a package which is not installed, and how to install it.

    Parameters
    ----------
    what : str
        What needs the package, in words.
    package : str
        Its module.
    extra : str or None
        Name of the extra that brings it; None if none does.
    key : str, optional
        Key of the job file that asks for it.
    """
    source = package if extra is None else f"'tjscan[{extra}]'"
    reason = f"{what} needs the package {package}, which is not installed: pip install {source}"
    return ConfigurationError(reason, key=key)


@contextmanager
def explain_missing_package(what: str, extra: str | None, key: str | None = None) -> Iterator[None]:
    """Name what to install if the block can't import a package; see `missing_package_error`.

    Raises
    ------
    ConfigurationError
        If a package is missing that is not this program's own.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        package = (error.name or "").partition(".")[0]
        if package == "tjscan":
            raise
        raise missing_package_error(what, package, extra, key) from error
