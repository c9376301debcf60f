"""The templates of the reports' pages."""

from __future__ import annotations

from jinja2 import Environment, PackageLoader, StrictUndefined, Template


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
