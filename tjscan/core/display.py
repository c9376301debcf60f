"""How results show themselves in a notebook: a table, a picture, a table of pandas."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from html import escape
from importlib import import_module
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from tjscan.core.errors import explain_missing_package

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SCREEN_DPI: Final = 110
"""Of a picture on the screen."""


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """A picture that a notebook shows.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
        To be changed, or saved with ``figure.savefig``.
    """

    figure: Figure

    def _repr_png_(self) -> bytes:
        stream = BytesIO()
        self.figure.savefig(stream, format="png", dpi=SCREEN_DPI)
        return stream.getvalue()


def rows_to_html(title: str, rows: Iterable[tuple[str, str]], picture: Path | None = None) -> str:
    """Table of names and values as HTML, under a title, over a PNG if one is named and there.

    Parameters
    ----------
    title : str
        In plain text, as the rows are.
    rows : iterable of (str, str)
        Name and value.
    picture : Path, optional
        The PNG.
    """
    cells = "".join(
        f'<tr><th style="text-align:left">{escape(name)}</th>'
        f'<td style="text-align:left">{escape(value)}</td></tr>'
        for name, value in rows
    )
    table = f"<table><caption>{escape(title)}</caption>{cells}</table>"
    if picture is None or not picture.is_file():
        return table
    data = b64encode(picture.read_bytes()).decode()
    return f'{table}<img alt="" style="max-width:100%" src="data:image/png;base64,{data}">'


def to_data_frame(columns: Mapping[str, Any]) -> Any:
    """Make a DataFrame of pandas from columns of one length.

    Raises
    ------
    ConfigurationError
        If pandas is not installed.
    """
    with explain_missing_package("a data frame", "pandas"):
        pandas = import_module("pandas")
    return pandas.DataFrame(dict(columns))
