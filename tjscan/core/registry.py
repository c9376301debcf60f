"""Named things that are loaded when they are asked for: drivers of devices."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from importlib.metadata import EntryPoint, entry_points
from typing import Any, Generic, TypeVar

from tjscan.core.errors import ConfigurationError, nearest_word

T = TypeVar("T")


@dataclass(frozen=True)
class Registry(Generic[T]):
    """Entries by name, such as drivers; each is imported only when it is loaded.

    Another package adds to it by an entry point in the group ``tjscan.<kind>``.

    Parameters
    ----------
    kind : str
        What its entries are, in one word for messages, for instance ``arm``.
    own : mapping of str to str
        Name of each entry of this package, and where it is: ``module:attribute``.
    extras : mapping of str to str
        For an entry that needs more than a plain install: the extra to install.
    key : str, optional
        Where a job file names an entry, for messages, for instance ``arm.driver``.
    type : type, optional
        What every entry is an instance of.
    """

    kind: str
    own: Mapping[str, str]
    extras: Mapping[str, str] = field(default_factory=dict)
    key: str | None = None
    type: type[Any] = object

    @cached_property
    def _places(self) -> dict[str, str]:
        found: dict[str, str] = {
            point.name: point.value for point in entry_points(group=f"tjscan.{self.kind}")
        }
        return {**found, **self.own}

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all entries, in alphabetical order."""
        return tuple(sorted(self._places))

    def load(self, name: str) -> T:
        """Import and return the entry of a name.

        Raises
        ------
        ConfigurationError
            If there is none, what it needs is not installed, or a package registered something
            else by that name.
        """
        if name not in self._places:
            raise ConfigurationError(
                f"there is no {self.kind} {name!r}; did you mean: "
                f"{nearest_word(name, self.names)}? Known: {', '.join(self.names)}",
                key=self.key,
            )
        place = self._places[name]
        try:
            with self.explain_missing_package(name):
                loaded: T = EntryPoint(name, place, f"tjscan.{self.kind}").load()
        except AttributeError as error:
            raise self._not_an_entry(name, f"can't be loaded: {error}") from error
        if not isinstance(loaded, self.type):
            raise self._not_an_entry(name, f"is no {self.type.__name__}")
        return loaded

    def _not_an_entry(self, name: str, why: str) -> ConfigurationError:
        return ConfigurationError(
            f"the {self.kind} {name!r} is registered as {self._places[name]}, which {why}",
            key=self.key,
        )

    @contextmanager
    def explain_missing_package(self, name: str) -> Iterator[None]:
        """Name the extra to install if the block can't import a package that an entry needs.

        Raises
        ------
        ConfigurationError
            If a package is missing that is not this program's own.
        """
        try:
            yield
        except ModuleNotFoundError as error:
            package = error.name or ""
            if package.split(".")[0] == "tjscan":
                raise
            raise self.missing_package_error(name, package) from error

    def missing_package_error(self, name: str, package: str) -> ConfigurationError:
        """Error that states what to install for an entry whose package is missing.

        Parameters
        ----------
        name : str
            Name of the entry.
        package : str
            Top-level module that is missing.
        """
        extra = self.extras.get(name)
        what = package if extra is None else f"'tjscan[{extra}]'"
        return ConfigurationError(
            f"the {self.kind} {name!r} needs the package {package}, which is not installed: "
            f"pip install {what}",
            key=self.key,
        )
