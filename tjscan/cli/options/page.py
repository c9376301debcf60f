"""The options of every command that shows something in a browser."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Final

from cyclopts import Parameter

from tjscan.core.errors import ConfigurationError, explain_missing_package

if TYPE_CHECKING:
    from tjscan.live.page import PageAddress


HIGHEST_PORT: Final = 65_535


@Parameter(name="*")
@dataclass(frozen=True, slots=True, kw_only=True)
class PageOptions:
    """Where the page is served.

    Parameters
    ----------
    port
        Port of the page in the browser; 0 for any that is free.
    address
        Address of this machine that the page is bound to. Anyone who has the printed address of a
        page with buttons moves machines by it: leave it at 127.0.0.1 unless the network is
        trusted.
    """

    port: int = 8080
    address: str = "127.0.0.1"

    @property
    def where(self) -> PageAddress:
        """Address and port of the page, once viser is found to be installed.

        Raises
        ------
        ConfigurationError
            If it is not installed, or there is no such port.
        """
        if not 0 <= self.port <= HIGHEST_PORT:
            raise ConfigurationError(f"--port is 0 to {HIGHEST_PORT}")
        with explain_missing_package("the page", "live"):
            from tjscan.live.page import PageAddress
        return PageAddress(port=self.port, address=self.address)


@Parameter(name="*")
@dataclass(frozen=True, slots=True, kw_only=True)
class LiveOptions(PageOptions):
    """Whether and where a run is shown in a browser while it goes on.

    Parameters
    ----------
    live
        Show the run in a browser while it goes on, with buttons that stop it.
    """

    port: Annotated[
        int, Parameter(help="With --live: port of the page; 0 for any that is free.")
    ] = 8080
    address: Annotated[
        str,
        Parameter(
            help="With --live: address of this machine that the page is bound to. Anyone who has "
            "the page's whole address moves machines by it: leave it at 127.0.0.1 unless the "
            "network is trusted."
        ),
    ] = "127.0.0.1"
    live: bool = False

    def check(self) -> None:
        """Check that the options go together, and that the page's server is installed.

        Raises
        ------
        ConfigurationError
            If not.
        """
        if self.live:
            _ = self.where
        elif self != type(self)():
            raise ConfigurationError("--port, --address and --wait go with --live")


@Parameter(name="*")
@dataclass(frozen=True, slots=True, kw_only=True)
class LiveScanOptions(LiveOptions):
    """Whether and where a scan is shown in a browser while it goes on.

    Parameters
    ----------
    live
        Show the scan in a browser while it goes on, with buttons that pause and stop it.
    wait
        With --live: begin when Start is pressed there.
    """

    wait: bool = False


@Parameter(name="*")
@dataclass(frozen=True, slots=True, kw_only=True)
class LiveCrawlOptions(LiveScanOptions):
    """Whether and where a crawl is shown in a browser while it goes on.

    Parameters
    ----------
    live
        Show the crawl in a browser while it goes on, with a button that stops it.
    wait
        With --live: begin when Start is pressed there; until then buttons drive while they are
        held.
    """
