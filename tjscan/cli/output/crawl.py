"""Output of the crawl commands: progress and tables on stderr, JSON on stdout."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from math import isfinite, nan
from pathlib import Path

from tjscan.cli.interrupt import ctrl_c_presser
from tjscan.cli.options.shared import LiveCrawlOptions
from tjscan.cli.output.console import ask_at_terminal, print_fields, print_json, print_message
from tjscan.crawler.method import OffsetEstimate
from tjscan.crawler.sizing import SizeFigure
from tjscan.crawler.slip_calibration import SlipCalibration
from tjscan.crawler.torch_axes import TorchJog
from tjscan.job.crawl.job import CrawlJob
from tjscan.recording.journal import CombinedJournal, RunEvent
from tjscan.report.write import write_run_report
from tjscan.runs.crawl.results import PASSES_FILE, read_passes
from tjscan.runs.crawl.run import AutomaticWeldOperator, CrawlContext
from tjscan.runs.run import nobody_objects


class EventPrinter:
    """A crawl's journal that prints its events."""

    def record(self, message: object) -> None:
        """Print an event; there are a hundred cycles a second."""
        if isinstance(message, RunEvent):
            print_message(f"{message.name}: {message.detail}")


class TerminalWeldOperator:
    """A `WeldOperator` who is asked at the terminal, and may jog the torch there.

    Parameters
    ----------
    jog : TorchJog
    """

    def __init__(self, jog: TorchJog) -> None:
        self._jog = jog

    def confirm_weld(self, number: int, assumed: str, *, looks: bool = False) -> bool:
        """Ask once before a pass; Ctrl-C stops the crawler instead."""
        if looks:
            way = "The way clear of people: drive along the weld and back with the arc out"
            return self._confirm(f"{way}, to see it before pass {number}?")
        ready = "Gas, wire and current ready, and the way clear of people"
        if assumed:
            ready = f"It is assumed that {assumed}: is it so? {ready}"
        return self._confirm(f"{ready}: weld pass {number}?")

    def confirm_torch(self) -> bool:
        """Ask once whether the torch is registered."""
        return self._confirm("Does the wire point at the middle of the joint?")

    def _confirm(self, question: str) -> bool:
        import questionary

        choice = "y, n, or millimetres by which to jog the torch to the right:"
        answer = str(questionary.text(f"{question} {choice}").unsafe_ask()).strip().lower()
        try:
            by = 1e-3 * float(answer)
        except ValueError:
            by = nan
        if isfinite(by):
            self._jog.move(by)
            limit = f"{1e3 * self._jog.limit:g} mm to either side at most"
            print_message(f"the torch is jogged by {1e3 * self._jog.offset:+.2f} mm, {limit}")
        elif answer not in ("y", "yes", "n", "no", ""):
            print_message(f"{answer!r} is neither y, n nor a number such as 1.5 or -1.5")
        return answer in ("y", "yes")


@contextmanager
def watch_crawl(
    job: CrawlJob, file: Path, page: LiveCrawlOptions | None = None, *, arc: bool = False
) -> Iterator[CrawlContext]:
    """Print a crawl's events, and write its report, while the block runs.

    Parameters
    ----------
    job : CrawlJob
    file : Path
        The file that it was read from.
    page : LiveCrawlOptions, optional
        Whether it is shown in a browser too, and driven by hand there before it begins.
    arc : bool, optional
        Whether the power source that the job names may strike an arc.
    """
    jog = TorchJog(job.torch.jog)
    simulated = job.simulation is not None
    operator = AutomaticWeldOperator() if simulated else TerminalWeldOperator(jog)
    ask = nobody_objects if simulated else ask_at_terminal
    context = CrawlContext(
        job, file, EventPrinter(), write_run_report, operator, jog=jog, arc=arc, ask=ask
    )
    if page is None or not page.live:
        yield context
        return
    from tjscan.runs.live.crawl import PageHandDrive, show_crawl

    hand, stop = PageHandDrive.of_job(job) if page.wait else None, ctrl_c_presser()
    with show_crawl(job, file.stem, page.page_address, print_message, stop, jog, hand) as shown:
        both = CombinedJournal(context.journal, shown)
        yield replace(context, journal=both, hand=hand)


def print_passes(directory: Path, *, json: bool) -> None:
    """Print the passes of a run."""
    rows = read_passes(directory)
    if json:
        print_json({"directory": str(directory), "passes": rows})
        return
    _print_pass_rows(rows, f"{directory / PASSES_FILE}")


def print_comparison(runs: Mapping[str, Sequence[Mapping[str, str]]], *, json: bool) -> None:
    """Print the passes of several runs below one another."""
    if json:
        print_json(runs)
        return
    for name, rows in runs.items():
        _print_pass_rows(rows, name)


def print_crawler_sizing(figures: Sequence[SizeFigure], *, json: bool) -> None:
    """Print the figures of a sizing, and which rules are broken."""
    if json:
        names = ("name", "value", "unit", "least", "most", "holds", "advice")
        rows = [{name: getattr(one, name) for name in names} for one in figures]
        for row in rows:
            row["value"] = row["value"] if isfinite(row["value"]) else None
        print_json(rows)
        return
    cells = []
    for one in figures:
        state = "" if not one.rule else "holds" if one.holds else "BROKEN"
        cells.append((one.name, f"{one.value:.4g} {one.unit}", one.rule, state))
    print_fields(cells, ("figure", "value", "rule", ""))
    for one in figures:
        if not one.holds:
            print_message(f"{one.name} is {one.value:.3g} {one.unit}".rstrip() + f": {one.advice}")


def print_slip_calibration(found: SlipCalibration, directory: Path, *, json: bool) -> None:
    """Print what a shuttle learned, with standard deviations."""
    if json:
        print(found.model_dump_json(indent=2))
        return
    print_fields(found.rows, ("quantity", "value", "standard deviation"))
    print_message(
        f'a job takes it with: calibration = "{directory.resolve() / "calibration.toml"}"'
    )


def print_registration(found: OffsetEstimate, *, json: bool) -> None:
    """Print where the torch is beside the laser's zero."""
    aside, sigma = round(1e3 * found.offset, 3), round(1e3 * found.sigma, 3)
    if json:
        print_json({"aside_mm": aside, "sigma_mm": sigma})
        return
    print_message(f"known to {sigma:g} mm; a job takes it with, in [torch]: aside_mm = {aside:g}")


def _print_pass_rows(rows: Sequence[Mapping[str, str]], title: str) -> None:
    if not rows:
        print_message(f"{title}: no pass was welded")
        return
    # Quantities go down and passes across: a terminal is not as wide as the file.
    head = ("", *(f"pass {row['pass']}" for row in rows))
    print_fields([(name, *(row[name] for row in rows)) for name in list(rows[0])[1:]], head, title)
