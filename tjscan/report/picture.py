"""Parts of a report's pages: pictures inlined as data, and the templates."""

from __future__ import annotations

from base64 import b64encode
from dataclasses import dataclass
from io import BytesIO
from typing import Any, Final

from jinja2 import Environment, PackageLoader, StrictUndefined, Template
from matplotlib import rc_context
from matplotlib.figure import Figure

SCREEN_DPI: Final = 110
MOST_LISTED_EVENTS: Final = 200
"""Events that a page lists; a run with more has other troubles."""

LINE_WITH_DOTS_STYLE: Final[dict[str, Any]] = {"marker": "o", "markersize": 3}
"""How a quantity is drawn along the groove: a line, with a dot at each section."""


@dataclass(frozen=True, slots=True)
class ReportPicture:
    """A picture of the report: its data, title and caption.

    Parameters
    ----------
    title, caption : str
        What it shows, and in one sentence what to see in it.
    data : str
        A ``data:`` URI that holds all of it.
    alt : str
        The same in words with its main numbers, for who can't see it; the title if left out.
    """

    title: str
    caption: str
    data: str
    alt: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "alt", self.alt or f"{self.title}.")


def draw_line_with_dots(axes: Any, x: Any, y: Any, colour: str, label: str, **style: Any) -> None:
    """Draw a quantity along the groove: a line, with a dot at each section."""
    axes.plot(x, y, color=colour, label=label, **style, **LINE_WITH_DOTS_STYLE)


def picture_from_png(content: bytes, title: str, caption: str) -> ReportPicture:
    """Make a picture of the content of a PNG file."""
    return ReportPicture(title, caption, _inline_data(content, "png"))


def new_figure(width: float, height: float) -> Figure:
    """Make an empty figure.

    Parameters
    ----------
    width, height : float
        Inches.
    """
    return Figure(figsize=(width, height), dpi=SCREEN_DPI, layout="constrained")


def inline_figure(
    figure: Any, title: str, caption: str, alt: str = "", *, vector: bool = False
) -> ReportPicture:
    """Turn a figure into a picture inside the HTML page.

    Parameters
    ----------
    figure : Figure
        Any of matplotlib's.
    title, caption, alt : str
        As of `ReportPicture`.
    vector : bool
        Whether its lines stay lines, as sharp as a printer draws them. What holds thousands of
        points is lighter as pixels.
    """
    stream = BytesIO()
    if vector:
        with rc_context({"svg.hashsalt": title}):  # the same names in every run
            figure.savefig(stream, format="svg", metadata={"Date": None})
    else:
        figure.savefig(stream, format="png", dpi=SCREEN_DPI, metadata={"Software": None})
    data = _inline_data(stream.getvalue(), "svg+xml" if vector else "png")
    return ReportPicture(title, caption, data, alt)


def _inline_data(content: bytes, kind: str) -> str:
    return f"data:image/{kind};base64,{b64encode(content).decode('ascii')}"


def load_template(name: str) -> Template:
    """Load a template of this package.

    Escaping is on for all of it: names of jobs and joints are text, whatever they hold.

    Parameters
    ----------
    name : str
        Of its file.
    """
    environment = Environment(
        loader=PackageLoader("tjscan.report", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
    )
    return environment.get_template(name)
