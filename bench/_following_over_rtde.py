"""Continuous scans over the loopback controller: corners, and faults at random moments.

The corners are those that are found with the simulated arm. Whatever faults come, the arm stays on
the paths that were checked, and the recording reads.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import cycle, islice
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Timer
from time import monotonic, process_time, sleep
from typing import Any, Final

import numpy as np
from _table import Row
from scipy.interpolate import CubicSpline
from scipy.spatial import cKDTree

from tjscan.core.errors import ArmFault, TjscanError
from tjscan.core.frames import Array
from tjscan.job.files import read_scan_job
from tjscan.laser.line_laser import StreamedProfile
from tjscan.laser.optics import SimulatedLaser
from tjscan.robot.arm import ArmState
from tjscan.robot.following import Following, JointMotion
from tjscan.robot.ur.arm import UrArm
from tjscan.robot.ur.dashboard import DashboardClient
from tjscan.robot.ur.following import UrFollowing
from tjscan.runs.scan.run import ScanContext, resume_scan, run_scan
from tjscan.scanning.continuous.scanner import ContinuousScanner
from tjscan.scanning.recording import read_recorded_scan
from tjscan.scanning.section import ScannedSection
from tjscan_loopback.process import UrLoopbackProcess
from tjscan_loopback.ur.faults import InjectedFault

PAPER: Final = Path(__file__).resolve().parents[1] / "examples" / "paper.toml"
HOST: Final = "127.0.0.6"
ENDING: Final = (
    *(InjectedFault.PROTECTIVE_STOP, InjectedFault.EMERGENCY_STOP, InjectedFault.POWER_OFF),
    *(InjectedFault.LOCAL_MODE, InjectedFault.DROP_LINK, InjectedFault.FREEZE),
    InjectedFault.STOP_PROGRAM,
)
"""Faults that end a scan."""

PASSING: Final = (
    *(InjectedFault.LOSE_PACKETS, InjectedFault.LATE_PACKETS, InjectedFault.DOUBLE_PACKETS),
    *(InjectedFault.REORDER_PACKETS, InjectedFault.FREEZE_REGISTERS),
    *(InjectedFault.SLIDER_HALF, InjectedFault.SLIDER_ZERO),
)
"""Faults that pass, and the scan goes on."""

FAULT_DURATION: Final = 1.0
"""Seconds until they do."""

LONGEST_WAIT: Final = 6.0
"""Seconds after the arm begins to follow within which the fault comes."""

LONGEST_END: Final = 4.0
"""Seconds in which a program that follows a path ends of itself."""

ON_PATH: Final = 1e-3
"""Radians by which an arm that lags behind cuts the corners of its path."""

FINE: Final = 2e-4
"""Seconds between places of a path to which distances are taken: in two milliseconds a joint turns
by two milliradians."""

OVER_RTDE: Final[dict[str, Any]] = {"arm.driver": "ur", "arm.ur": {"host": HOST}}
SCAN_KEYS: Final = {"scan.mode": "continuous", "scan.length_mm": 60.0} | OVER_RTDE
FAULTLESS: Final[dict[str, Any]] = {
    "scan.mode": "continuous",
    "scan.length_mm": 60.0,
    "scan.speed_mm_s": 20.0,
    "simulation.laser.noise_mm": 0.002,
    **dict.fromkeys(
        [
            *("simulation.arm.repeatability_mm", "simulation.arm.repeatability_deg"),
            *(f"simulation.laser.{fault}_mm" for fault in ("bias", "resolution")),
            *(f"simulation.laser.{fault}" for fault in ("dropout", "missing", "ghosts", "flyers")),
        ],
        0,
    ),
}
"""Of scans whose corners are compared; a profile that is another's twin does not count."""

A_MINUTE: Final = {"scan.mode": "continuous", "scan.length_mm": 540.0, "scan.speed_mm_s": 9.0}

SECTIONS_OF_START, SECTIONS_OF_END = 10, 3
"""Sections that are left out: at the start those of both arms are up to 0.15 mm off."""


class Watch:
    """Watches an arm that follows: the paths it was given, where it was, and where it ended."""

    def __init__(self) -> None:
        self.paths: list[JointMotion] = []
        self.seen: list[Array] = []
        self.begun = self.ended_on_path = False
        self.timers: list[Timer] = []

    def farthest(self, q: list[Array]) -> float:
        """Largest distance of joint angles from the paths, radians."""
        if not q:
            return 0.0
        fine = [path.at(np.arange(path.times[0], path.end + FINE, FINE))[0] for path in self.paths]
        away, _ = cKDTree(np.concatenate(fine)).query(np.array(q), p=np.inf)
        return float(np.max(away))

    @contextmanager
    def over(self) -> Iterator[None]:
        """Watch every arm that follows while the block runs."""
        follow, replace, states = UrArm.follow, UrFollowing.replace, UrFollowing.states

        @contextmanager
        def watched_follow(arm: UrArm) -> Iterator[Following]:
            self.ended_on_path = True
            with follow(arm) as following:
                self.paths.append(JointMotion.at_rest(arm.state().q, 0.0))
                if not self.begun:
                    self.begun = True
                    for timer in self.timers:
                        timer.start()
                yield following
            self.ended_on_path = False  # and it moves otherwise from here

        def watched_replace(following: UrFollowing, motion: JointMotion) -> None:
            self.paths.append(motion)
            replace(following, motion)

        def watched_states(following: UrFollowing) -> Sequence[ArmState]:
            found = states(following)
            self.seen += [state.q for state in found[::10]]
            return found

        UrArm.follow = watched_follow  # type: ignore[method-assign, assignment]
        UrFollowing.replace = watched_replace  # type: ignore[method-assign, assignment]
        UrFollowing.states = watched_states  # type: ignore[method-assign, assignment]
        try:
            yield
        finally:
            UrArm.follow = follow  # type: ignore[method-assign]
            UrFollowing.replace = replace  # type: ignore[method-assign]
            UrFollowing.states = states  # type: ignore[method-assign]


def await_end_of_program(loopback: UrLoopbackProcess) -> None:
    """Let the controller go on, until its program has ended; a link that broke can't end it."""
    loopback.schedule_fault("clear")
    dashboard, until = DashboardClient(HOST), monotonic() + LONGEST_END
    while dashboard.ask_dashboard_value("running") != "false":
        sleep(0.05)
        if monotonic() > until:
            dashboard.stop_program()
    dashboard.close()


def joint_angles() -> Array:
    """Joint angles that another client sees."""
    from rtde_receive import RTDEReceiveInterface

    link = RTDEReceiveInterface(HOST, 125.0, ["actual_q"])
    try:
        sleep(0.1)
        return np.array(link.getActualQ())
    finally:
        link.disconnect()


def resumed(run: Path) -> bool:
    """Whether a scan that broke off goes on to its end."""
    left = run / "job.toml"
    try:
        return resume_scan(ScanContext(read_scan_job(left), left)).complete
    except TjscanError as error:
        print(f"not resumed: {type(error).__name__}: {error}", file=sys.stderr)
        return False


def try_fault(
    loopback: UrLoopbackProcess, fault: InjectedFault, seconds: float
) -> tuple[float, bool, bool, bool]:
    """Scan with a fault: radians off the paths; if it ends as it should, records, is resumed."""
    await_end_of_program(loopback)
    loopback.schedule_fault("home")
    watch = Watch()
    watch.timers = [Timer(seconds, loopback.schedule_fault, [str(fault)])]
    if fault in PASSING:
        watch.timers.append(Timer(seconds + FAULT_DURATION, loopback.schedule_fault, ["clear"]))
    job, ended = read_scan_job(PAPER, SCAN_KEYS), "done"
    with TemporaryDirectory() as folder, watch.over():
        run = Path(folder) / "run"
        try:
            run_scan(ScanContext(job, PAPER), run)
        except TjscanError as error:
            ended = f"{type(error).__name__}: {error}"
            # Registers frozen for as long as the program waits for a sign of life may end it, too.
            ends = fault in ENDING or fault is InjectedFault.FREEZE_REGISTERS
            expected = isinstance(error, ArmFault) and ends
        else:
            expected = True  # it passed, or came after the scan
        for timer in watch.timers:
            timer.cancel()
        await_end_of_program(loopback)
        views = len(read_recorded_scan(run).views)
        end = [joint_angles()] if watch.ended_on_path else []
        whole = ended == "done" or resumed(run)
    off = watch.farthest(watch.seen + end)
    print(
        f"{fault} after {seconds:.2f} s: {ended[:90]}; {1e3 * off:.3f} mrad off, {views} views",
        file=sys.stderr,
    )
    return off, expected, views > 0, whole


def corners_of_scan(keys: dict[str, Any]) -> Array:
    """Outer corners p2 and p4 of each section in frame b, shape (m, 2, 3)."""
    with TemporaryDirectory() as folder:
        run_scan(ScanContext(read_scan_job(PAPER, keys), PAPER), Path(folder) / "run")
        sections = read_recorded_scan(Path(folder) / "run").sections.values()
    return np.array([section.points_b[[1, 3]] for section in sections])


def distance_apart(found: Array, reference: Array) -> float:
    """Largest distance of points, shape (m, 3), from the curve through others, metres."""
    gone = np.linalg.norm(np.diff(reference, axis=0), axis=1).cumsum()
    curve = CubicSpline(np.append(0.0, gone), reference)
    fine = curve(np.arange(0.0, gone[-1], 1e-5))
    inside = found[SECTIONS_OF_START:-SECTIONS_OF_END]
    return max(float(np.linalg.norm(fine - point, axis=1).min()) for point in inside)


def rows_of_a_minute() -> Iterator[Row]:
    """Profiles kept of those taken in a minute, and how late sections are read."""
    stream, finish = SimulatedLaser.stream, ContinuousScanner._finish
    taken, late = list[bytes](), list[float]()

    def counted(laser: SimulatedLaser, period: float) -> Iterator[StreamedProfile]:
        taken.clear()  # of the shuttle
        for streamed in stream(laser, period):
            taken.append(streamed.profile.digest)
            yield streamed

    def timed(scanner: ContinuousScanner, length: float, section: ScannedSection) -> None:
        finish(scanner, length, section)
        late.append(scanner._setup.arm.state().time - section.view.time)

    SimulatedLaser.stream = counted  # type: ignore[method-assign, assignment]
    ContinuousScanner._finish = timed  # type: ignore[method-assign, assignment]
    try:
        with TemporaryDirectory() as folder:
            job = read_scan_job(PAPER, A_MINUTE | OVER_RTDE)
            start = process_time()
            run_scan(ScanContext(job, PAPER), Path(folder) / "run")
            cores = process_time() - start
            views = read_recorded_scan(Path(folder) / "run").views
    finally:
        SimulatedLaser.stream, ContinuousScanner._finish = stream, finish  # type: ignore[method-assign]
    kept = {view.profile.digest for view in views}
    came = [i for i, digest in enumerate(taken) if digest in kept]
    lost = 1 + came[-1] - came[0] - len(came)
    seconds = views[-1].time - views[0].time
    yield Row("a minute over RTDE: profiles, simulated in the process", len(taken), np.inf)
    yield Row("… not recorded between the first and the last", lost, 0)
    yield Row("… a section read after it was passed, p99", float(np.percentile(late, 99)), 1, "s")
    yield Row("… cores, simulated laser and all", cores / seconds, np.inf)


def over_rtde_rows(faults: int) -> Iterator[Row]:
    """Measure every bar, with so many faults."""
    random = np.random.default_rng()
    with UrLoopbackProcess(HOST, "--hz", "500", "--fast", "--clock", "700", "70") as loopback:
        simulated = corners_of_scan(FAULTLESS)
        wire = corners_of_scan(FAULTLESS | OVER_RTDE)
        apart = [distance_apart(wire[:, k], simulated[:, k]) for k in range(2)]
        yield Row(
            "over RTDE: corners from those of the simulated arm", 1e3 * max(apart), 0.05, "mm"
        )
        yield from rows_of_a_minute()
        kinds = [*ENDING, *PASSING]
        random.shuffle(kinds)
        faulty = islice(cycle(kinds), faults)
        found = [try_fault(loopback, one, random.uniform(0.0, LONGEST_WAIT)) for one in faulty]
    offs, ends, recorded, whole = np.array(found).T
    name = f"{faults} faults over RTDE"
    yield Row(f"{name}: off the checked path", float((offs > ON_PATH).sum()), 0)
    yield Row(f"{name}: farthest beside it, through lag", 1e3 * offs.max(), 1e3 * ON_PATH, "mrad")
    yield Row(f"{name}: ended as they should", ends.sum(), faults, "", faults)
    yield Row(f"{name}: recordings that read", recorded.sum(), faults, "", faults)
    yield Row(f"{name}: scans whole, those that broke off resumed", whole.sum(), faults, "", faults)
