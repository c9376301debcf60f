"""What the live page shows of a crawl: while it goes on, and of its recording."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from math import isfinite
from pathlib import Path
from typing import Final

import numpy as np

from tjscan.core.frames import pose, rot_z, transform_points
from tjscan.crawler.journal import CrawlCycle, read_crawl
from tjscan.crawler.phases import PHASE_TRANSITIONS, Event, Phase
from tjscan.crawler.torch_axes import TorchJog
from tjscan.job.crawl.job import CrawlJob, read_crawl_job
from tjscan.laser.profile import Profile
from tjscan.live import step as live_step
from tjscan.live.colours import FITTED_COLOUR, LASER_COLOUR, NOMINAL_COLOUR, SOLID_COLOUR
from tjscan.live.drawables import BodyPose, Drawable, Lines, MeasuredPiece, Surface
from tjscan.live.listening import Report, RunOnPage, show_run
from tjscan.live.page import Act, Button, PageAddress, stop_button
from tjscan.recording.journal import RunEvent
from tjscan.result.directory import JOB_FILE
from tjscan.robot.settings import Box, Cylinder, Solid
from tjscan.vehicle.vehicle import AT_REST, Twist

TORCH_DEVIATION_MEASURE: Final = live_step.Measure("torch beside its path", "mm")
VEHICLE_OFFSET_MEASURE: Final = live_step.Measure("vehicle beside the joint", "mm")
TORCH_SIGMA_MEASURE: Final = live_step.Measure("torch known to", "mm")
TORQUE_MEASURE: Final = live_step.Measure("largest torque", "N m")
SPEED_MEASURE: Final = live_step.Measure("speed by the encoders", "mm/s")

DRAWN_CRAWLER_HEIGHT: Final = 0.12
"""Metres, of the drawn tracks."""
DRAWN_LASER_HEIGHT: Final = 0.2
"""Metres of the drawn laser over the hull."""
DRAWN_JOINT_WIDTH: Final = 0.02
"""Metres of the drawn joint, where no simulation states it."""
DRAWN_WELD_PIECE_LENGTH: Final = 5e-3
"""Metres of travel that a drawn piece of weld is long."""
DRAWN_WELD_WIDTH: Final = 0.01
"""Metres, of the drawn weld."""
SECONDS_BETWEEN_PAGE_STEPS: Final = 0.25
"""Seconds of the vehicle's clock between two steps of a recording."""

SECONDS_BETWEEN_PAGE_CYCLES: Final = 0.05
"""Of the vehicle's clock, between two cycles that are handed to the page."""
NOT_KNOWN_AT_REST: Final = {"speed": "", "arc": ""}
"""Facts of the cycle before the vehicle came to rest, which are past; another cycle states them."""
BUTTON_HOLD_LIFETIME: Final = 0.3
"""Seconds for which the page's last word that a button is held counts; the page repeats it 20 times
a second. It leaves the rest of a vehicle's `DEAD_MAN_TIME` to brake in."""
JOG_STEP: Final = 0.05e-3
"""Metres by which the torch is jogged each time the page says that a button is held: 1 mm/s."""
LEAST_DRIVE_ORDER_INTERVAL: Final = 0.01
"""Seconds between two orders at least: a simulated vehicle waits for nothing."""


class CrawlShow:
    """Turns what a crawl's journal receives into steps of the page.

    In the picture x leads along the joint from the beginning of the weld, y to its left, z out of
    the hull; the vehicle is drawn at its method's estimate.

    Parameters
    ----------
    job : CrawlJob
    title : str
        Of the run.
    """

    def __init__(self, job: CrawlJob, title: str) -> None:
        self._job, self._piece = job, 0
        simulated = job.simulation and job.simulation.joint.width
        self._joint_width = simulated or DRAWN_JOINT_WIDTH
        self._last: tuple[int, float, float] | None = None
        self.setting = self._make_scene_setup(title)

    def step_of_entry(self, entry: object) -> live_step.Step:
        """Return what one entry of the journal changes on the page."""
        match entry:
            case CrawlCycle():
                return self._cycle_step(entry)
            case Profile():
                return live_step.Step(profile=live_step.PlaneCurve.of_profile(entry))
            case RunEvent(name, detail):
                step = live_step.Step(name, events=((name, detail),))
                if name not in set(Phase):
                    return step
                # An event that a phase begins with bears its name: no cycle follows a stop.
                diagram = phase_transition_diagram(Phase(name))
                past = NOT_KNOWN_AT_REST if name in (Phase.STOP, Phase.MANUAL) else {}
                facts = {live_step.STATE_FACT: name, **past}
                return replace(step, facts=facts, diagram=diagram)
        return live_step.Step()

    def _make_scene_setup(self, title: str) -> live_step.SceneSetup:
        job, length = self._job, self._job.weld.length
        before = job.alignment.length + job.weld.run_up
        vehicle = tuple(_crawler_solids(job))
        torch = Solid("torch", Cylinder(0.012, 0.25), pose(p=(0.0, 0.0, 0.125)))
        ends = np.array([(-before, 0.0, 0.0), (length + job.weld.run_up, 0.0, 0.0)])
        weld = np.array([(0.0, 0.0, 0.0), (length, 0.0, 0.0)])
        wide = np.array((0.0, 0.6, -1e-3))
        hull = np.vstack((ends - wide, (ends + wide * (1, 1, -1))[::-1]))
        edge = np.array((0.0, 0.5 * self._joint_width, 1e-3))
        joint = np.vstack((ends - edge * (1, 1, -1), (ends + edge)[::-1]))
        square = np.array([(0, 1, 2), (0, 2, 3)])
        middle = np.array((0.5 * (length - before), 0.0, 0.0))
        away = length + before + 2 * job.vehicle.body_length
        return live_step.SceneSetup(
            title,
            (
                TORCH_DEVIATION_MEASURE,
                VEHICLE_OFFSET_MEASURE,
                TORCH_SIGMA_MEASURE,
                TORQUE_MEASURE,
                SPEED_MEASURE,
            ),
            "along the joint / mm",
            see_through=("vehicle",),
            bodies={"vehicle": vehicle, "torch": (torch,)},
            ghost=(
                Surface(hull, square, NOMINAL_COLOUR, 0.35),
                Surface(joint, square, SOLID_COLOUR),
                Lines.through(weld, colour=FITTED_COLOUR, width=2.0),
            ),
            look_at=middle,
            look_from=middle + away * np.array((-0.35, -0.9, 0.7)),
        )

    def _cycle_step(self, cycle: CrawlCycle) -> live_step.Step:
        torch, state = cycle.torch, cycle.state
        torch_place = cycle.travel, -(torch.offset + cycle.torch_y), 0.0
        values = {
            TORCH_DEVIATION_MEASURE.name: 1e3 * cycle.deviation,
            VEHICLE_OFFSET_MEASURE.name: 1e3 * torch.offset,
            TORCH_SIGMA_MEASURE.name: 1e3 * torch.sigma,
            SPEED_MEASURE.name: 1e3 * state.odometry.speed,
        }
        if state.torques:
            values[TORQUE_MEASURE.name] = max(map(abs, state.torques))
        drawn: dict[str, Drawable] = {
            "vehicle": BodyPose(pose(rot_z(-torch.heading), (cycle.travel, -torch.offset, 0.0))),
            "torch": BodyPose(pose(p=torch_place)),
            "laser": self._laser_plane(cycle),
        }
        samples: tuple[live_step.Sample, ...] = ()
        if cycle.arc and (piece := self._next_piece_of_weld(cycle, values)) is not None:
            self._piece += 1
            drawn[f"weld/{self._piece}"] = piece
            samples = (live_step.Sample(1e3 * cycle.travel, values),)
        progress = None
        if cycle.phase is Phase.WELDING and cycle.number:
            along = min(max(cycle.travel / self._job.weld.length, 0.0), 1.0)
            progress = (cycle.number - 1 + along) / len(self._job.passes)
        label, facts = f"{cycle.phase}, {1e3 * cycle.travel:.0f} mm", self._cycle_facts(cycle)
        diagram = phase_transition_diagram(cycle.phase)
        return live_step.Step(label, drawn, facts, progress, samples, diagram=diagram)

    def _laser_plane(self, cycle: CrawlCycle) -> Surface:
        """The laser's plane, from the sensor in front down to its line across the joint."""
        ahead, half = self._job.vehicle.laser_to_torch, 1.5 * self._joint_width
        corners = [(ahead, 0.0, DRAWN_LASER_HEIGHT), (ahead, -half, 0.0), (ahead, half, 0.0)]
        at = pose(rot_z(-cycle.torch.heading), (cycle.travel, -cycle.torch.offset, 0.0))
        return Surface(transform_points(at, corners), np.array([(0, 1, 2)]), LASER_COLOUR, 0.4)

    def _cycle_facts(self, cycle: CrawlCycle) -> dict[str, str]:
        reading = f"{1e3 * cycle.d:+.2f} ± {1e3 * cycle.d_sigma:.2f} mm" if cycle.was_read else "no"
        proximity = [value for value in cycle.state.proximity if isfinite(value)]
        nearest = {"nearest corner": f"{1e3 * min(proximity):.0f} mm"} if proximity else {}
        return {
            live_step.STATE_FACT: str(cycle.phase),
            "pass": f"{cycle.number} of {len(self._job.passes)}" if cycle.number else "",
            "along the joint": f"{1e3 * cycle.travel:z.0f} of {1e3 * self._job.weld.length:.0f} mm",
            "speed": f"{1e3 * cycle.state.odometry.speed:z.1f} mm/s",
            "joint read": reading,
            "arc": "burns" if cycle.arc else "off",
            "torch jogged by": f"{1e3 * cycle.jog:+.2f} mm",
            **nearest,  # not in every cycle
            "fault": cycle.state.fault,
        }

    def _next_piece_of_weld(
        self, cycle: CrawlCycle, values: dict[str, float]
    ) -> MeasuredPiece | None:
        """The weld since the last piece, once it is long enough; passes are on one another."""
        here = cycle.number, cycle.travel, -(cycle.torch.offset + cycle.torch_y)
        number, x0, y0 = self._last or here
        is_same_pass = self._last is not None and number == cycle.number
        if is_same_pass and abs(cycle.travel - x0) < DRAWN_WELD_PIECE_LENGTH:
            return None
        self._last = here
        if not is_same_pass:
            return None
        _, x, y = here
        z, half = 4e-3 * cycle.number, 0.5 * DRAWN_WELD_WIDTH
        strip = [(x0, y0 - half, z), (x0, y0 + half, z), (x, y - half, z), (x, y + half, z)]
        triangles = np.array([(0, 1, 2), (1, 3, 2)])
        return MeasuredPiece(np.empty((0, 3)), np.array(strip), triangles, values)


def _crawler_solids(job: CrawlJob) -> Iterator[Solid]:
    """Tracks, the body between them, and in front the laser on its boom; the torch is at 0."""
    vehicle, high = job.vehicle, DRAWN_CRAWLER_HEIGHT
    middle, ahead, side = vehicle.centre_to_torch, vehicle.laser_to_torch, 0.5 * vehicle.body_width
    length, front = vehicle.body_length, middle + 0.4 * vehicle.body_length
    boom = max(ahead - front, 0.02)
    for name, y in (("left track", side), ("right track", -side)):
        place = pose(p=(middle, 0.84 * y, 0.5 * high))
        yield Solid(name, Box((length, 0.32 * side, high)), place)
    body = Box((0.8 * length, 1.3 * side, 0.4 * high))
    yield Solid("body", body, pose(p=(middle, 0.0, high)))
    for name, size, x in (
        ("boom", (boom, 0.04, 0.03), front + 0.5 * boom),
        ("laser", (0.06, 0.14, 0.09), ahead),
    ):
        yield Solid(name, Box(size), pose(p=(x, 0.0, DRAWN_LASER_HEIGHT)))


def phase_transition_diagram(now: Phase) -> live_step.StateDiagram:
    """The phases and what leads from one to another, the present one marked."""
    ways = ((phase, after, event) for (phase, event), after in PHASE_TRANSITIONS.items())
    arrows = tuple((str(a), str(b), str(why)) for a, b, why in ways if why is not Event.DANGER)
    return live_step.StateDiagram(tuple(map(str, Phase)), arrows, str(now), str(Phase.STOP))


def read_crawl_show(directory: Path) -> tuple[CrawlShow, Iterator[object]]:
    """Read what a crawl's recording has to show; see `tjscan.live.step.ReplayReader`."""
    show = CrawlShow(read_crawl_job(directory / JOB_FILE), directory.resolve().name)
    return show, _read_thinned_entries(directory)


def _read_thinned_entries(directory: Path) -> Iterator[object]:
    """Events, and a cycle with its profile now and then."""
    due, with_profile = -np.inf, False
    for entry in read_crawl(directory):
        match entry:
            case CrawlCycle(state=state, profile=profile):
                if state.time >= due:
                    due, with_profile = state.time + SECONDS_BETWEEN_PAGE_STEPS, True
                    yield entry
                if profile is not None and with_profile:
                    with_profile = False
                    yield profile
            case RunEvent():
                yield entry


class PageHandDrive:
    """A `HandDrive` whose orders are buttons of the page that are held.

    It hears that a button is held again and again, and not that it is released: a page that is
    closed, a browser that dies and a network that fails send nothing, and so stop the vehicle too.
    Buttons that contradict each other, held in two browsers, stop it as well.

    Parameters
    ----------
    speed : float
        To drive at, m/s.
    curvature : float
        Of the turns, 1/m.
    clock : callable, optional
        Gives seconds.
    wait : callable, optional
        Waits for as many seconds.
    """

    def __init__(
        self,
        speed: float,
        curvature: float,
        clock: Callable[[], float] = time.monotonic,
        wait: Callable[[float], object] = time.sleep,
    ) -> None:
        turn = speed * curvature
        self._twists = {
            "Hold: forward": Twist(speed, 0.0),
            "Hold: forward, left": Twist(speed, -turn),
            "Hold: forward, right": Twist(speed, turn),
            "Hold: back": Twist(-speed, 0.0),
        }
        self._heard = dict.fromkeys(self._twists, float("-inf"))
        self._clock, self._wait, self._last = clock, wait, float("-inf")
        self._begun = threading.Event()

    @classmethod
    def of_job(cls, job: CrawlJob) -> PageHandDrive:
        """Drive as slowly as the crawler aligns, and turn as tightly as its motors may."""
        return cls(job.alignment.speed, 1 / job.steering.least_radius)

    @property
    def button_words(self) -> Sequence[str]:
        """Words of the buttons that drive."""
        return tuple(self._twists)

    def start_crawl(self) -> None:
        """Let the crawl begin: driving by hand is over."""
        self._begun.set()

    def note_held(self, word: str) -> None:
        """Note that a button is held."""
        self._heard[word] = self._clock()

    def order(self) -> Twist | None:
        """Return what is asked for now; see `HandDrive.order`."""
        self._wait(max(0.0, self._last + LEAST_DRIVE_ORDER_INTERVAL - self._clock()))
        self._last = now = self._clock()
        if self._begun.is_set():
            return None
        held = [word for word, heard in self._heard.items() if now - heard < BUTTON_HOLD_LIFETIME]
        return self._twists[held[0]] if len(held) == 1 else AT_REST


class CrawlPageJournal:
    """A crawl's journal that hands cycles and profiles to the page now and then, and all events.

    Parameters
    ----------
    run : RunOnPage
    """

    def __init__(self, run: RunOnPage) -> None:
        self._run, self._due = run, float("-inf")

    def record(self, message: object) -> None:
        """Show an event, or a cycle if the last one is a while ago."""
        match message:
            case CrawlCycle(state=state, profile=profile) if state.time >= self._due:
                self._due = state.time + SECONDS_BETWEEN_PAGE_CYCLES
                self._run.record(message)
                if profile is not None:
                    self._run.record(profile)
            case RunEvent():
                self._run.record(message)


@contextmanager
def show_crawl(
    job: CrawlJob,
    title: str,
    where: PageAddress,
    report: Report,
    interrupt: Act,
    jog: TorchJog,
    hand: PageHandDrive | None = None,
) -> Iterator[CrawlPageJournal]:
    """Show a crawl while the block runs; gives the journal that shows it.

    Parameters
    ----------
    job : CrawlJob
    title : str
        Of the run.
    where : PageAddress
    report : callable
        Receives the page's address, or why there is none.
    interrupt : callable
        Does what Ctrl-C does.
    jog : TorchJog
        Takes what is jogged on it.
    hand : PageHandDrive, optional
        Who drives by hand on it before the crawl begins.

    Raises
    ------
    PageUnavailable
        If there is no page, and it is to be driven on one.
    """

    def buttons(run: RunOnPage) -> Sequence[Button]:
        always = [*stop_button(interrupt, "the crawler"), *jog_buttons(jog)]
        return always if hand is None else [*always, *hand_drive_buttons(run, hand)]

    with show_run(CrawlShow(job, title), where, report, buttons) as run:
        if hand is not None:
            run.check_page()
        yield CrawlPageJournal(run)


def jog_buttons(jog: TorchJog) -> Sequence[Button]:
    """Buttons that jog the torch while they are held; none if it may not be jogged."""
    hint = f"Jogs the torch beside its path while it is held, {1e3 * jog.limit:g} mm at most"
    ways = {"Hold: torch left": -JOG_STEP, "Hold: torch right": JOG_STEP}
    if not jog.limit:
        return []
    return [Button(word, partial(jog.move, by), hint=hint, held=True) for word, by in ways.items()]


def hand_drive_buttons(run: RunOnPage, hand: PageHandDrive) -> Sequence[Button]:
    """Buttons that drive a crawler while they are held, and Start, which takes them away.

    Parameters
    ----------
    run : RunOnPage
    hand : PageHandDrive
    """

    def start() -> None:
        hand.start_crawl()
        if run.page is not None:
            run.page.withdraw_buttons(("Start", *hand.button_words))
        run.record(live_step.Step(facts={live_step.BUTTONS_FACT_NAME: ""}))

    run.record(
        live_step.Step(facts={live_step.BUTTONS_FACT_NAME: "Start, or hold a button to drive"})
    )
    hint = "Drives slowly while it is held; released, or gone with the page, the crawler stops"
    words = hand.button_words
    held = [Button(word, partial(hand.note_held, word), hint=hint, held=True) for word in words]
    return [Button("Start", start, "green", "Let the crawl begin"), *held]
