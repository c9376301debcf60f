"""Packages that only some commands need: what to install where one is missing."""

from __future__ import annotations

from tjscan.core.errors import ConfigurationError


def package_missing(
    error: ModuleNotFoundError, what: str, extra: str, key: str | None = None
) -> ConfigurationError:
    """Error that names a package which is not installed, and the extra that brings it.

    Parameters
    ----------
    error : ModuleNotFoundError
        Of the import; raised again where it is of a module of tjscan itself.
    what : str
        What needs the package, in words.
    extra : str
        Name of the extra.
    key : str, optional
        Key of the job file that asks for it.
    """
    package = (error.name or "").partition(".")[0]
    if package == "tjscan":
        raise error
    return ConfigurationError(
        f"{what} needs the package {package}, which is not installed: "
        f"pip install 'tjscan[{extra}]'",
        key=key,
    )
