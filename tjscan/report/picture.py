"""Pictures as they stand in a report: drawn, and inlined as data."""

from __future__ import annotations

from base64 import b64encode
from dataclasses import dataclass
from io import BytesIO
from typing import Any, Final

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

DPI: Final = 110


@dataclass(frozen=True, slots=True)
class ReportPicture:
    """A picture of the report: its data, title and caption.

    Parameters
    ----------
    title, caption : str
        What it shows, and in one sentence what to see in it.
    data : str
        A ``data:`` URI that holds all of it.
    """

    title: str
    caption: str
    data: str


def new_figure(width: float, height: float) -> Figure:
    """Make an empty figure.

    Parameters
    ----------
    width, height : float
        Inches.
    """
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def inline_figure(figure: Any, title: str, caption: str) -> ReportPicture:
    """Turn a figure into a picture that stands inside the HTML page.

    Parameters
    ----------
    figure : Figure
        Any of matplotlib's.
    title, caption : str
        As of `ReportPicture`.
    """
    stream = BytesIO()
    figure.savefig(stream, format="png", dpi=DPI, metadata={"Software": None})
    data = "data:image/png;base64," + b64encode(stream.getvalue()).decode("ascii")
    return ReportPicture(title, caption, data)
