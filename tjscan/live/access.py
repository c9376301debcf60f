"""The server of the page: bound to one address, silent, and closed to all without its token.

Buttons of the page move machines, and viser has no login. Any site that is open in the same
browser may connect to a socket of this machine, so the token is asked for on 127.0.0.1 too. It
is in the path of the URL, for the page and for its socket alike.
"""

from __future__ import annotations

import socket
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from hmac import compare_digest
from http import HTTPStatus
from http.client import HTTPConnection
from typing import Any, Final
from urllib.parse import urlsplit

import rich
import viser
from websockets import Headers
from websockets.asyncio import server as websockets_server
from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response

from tjscan.core.devices import is_loopback_host
from tjscan.core.errors import PageUnavailable

LOOPBACK_ADDRESS: Final = "127.0.0.1"
SERVER_CHECK_TIMEOUT: Final = 5.0
"""Seconds within which the server answers its own check of whether it is closed."""

HttpAnswer = Callable[[ServerConnection, Request], Response | None]


class UnsharedServer(viser.ViserServer):
    """Server that never publishes the page through viser's relay."""

    def request_share_url(self, verbose: bool = True) -> None:
        """Ask no relay for anything: no request leaves the machine."""


def open_server(address: str, port: int, token: str, label: str) -> viser.ViserServer:
    """Open the page's server.

    Parameters
    ----------
    address : str
        To bind to.
    port : int
        To bind to; 0 for any that is free.
    token : str
        What the path of every request must begin with.
    label : str
        Of the panel.

    Raises
    ------
    PageUnavailable
        If the port is taken, the address is none of this machine's, or the server answers
        without the token.
    """
    _check_can_bind(address, port)
    with _servers_require_token(address, token):
        server = UnsharedServer(host=address, port=port, label=label, verbose=False)
    try:
        if port and server.get_port() != port:
            raise PageUnavailable(f"port {port} of {address} was taken meanwhile")
        if status_without_token(address, server.get_port()) != HTTPStatus.FORBIDDEN:
            raise PageUnavailable(
                "the installed viser answers without the page's token: install the version that "
                "tjscan[live] names"
            )
    except PageUnavailable:
        close_server(server)
        raise
    return server


def close_server(server: viser.ViserServer) -> None:
    """End the page."""
    with _silenced_viser():
        server.stop()


def status_without_token(address: str, port: int) -> int:
    """HTTP status that the server answers a request without the token with.

    Raises
    ------
    PageUnavailable
        If it does not answer.
    """
    try:
        with closing(HTTPConnection(address, port, timeout=SERVER_CHECK_TIMEOUT)) as connection:
            connection.request("GET", "/")
            return connection.getresponse().status
    except OSError as error:
        raise PageUnavailable(f"the page's server does not answer: {error}") from error


def _check_can_bind(address: str, port: int) -> None:
    """If a port is taken, viser would take the next one without a word."""
    try:
        family = socket.AF_INET6 if ":" in address else socket.AF_INET
        with socket.socket(family, socket.SOCK_STREAM) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind((address, port))
    except OSError as error:
        raise PageUnavailable(
            f"port {port} of {address} can't be had: {error.strerror or error}; choose another "
            "with --port"
        ) from error


@contextmanager
def _servers_require_token(address: str, token: str) -> Iterator[None]:
    """While the block runs, servers are made that ask for the token."""
    serve = websockets_server.serve

    def serve_guarded(*arguments: Any, process_request: HttpAnswer, **options: Any) -> Any:
        guarded = _require_token(address, token, process_request)
        return serve(*arguments, process_request=guarded, **options)

    websockets_server.serve = serve_guarded  # type: ignore[misc,assignment]
    try:
        with _silenced_viser():
            yield
    finally:
        websockets_server.serve = serve  # type: ignore[misc]


@contextmanager
def _silenced_viser() -> Iterator[None]:
    """While the block runs, viser prints nothing: stdout is for results."""
    print_rich, rich.print = rich.print, lambda *_, **__: None
    try:
        yield
    finally:
        rich.print = print_rich


def _require_token(address: str, token: str, answer: HttpAnswer) -> HttpAnswer:
    """Refuse what has not the token, pages and sockets alike, or comes from another site's page."""

    def answer_with_token(connection: ServerConnection, request: Request) -> Response | None:
        first, _, rest = request.path.lstrip("/").partition("/")
        if not compare_digest(first.encode(), token.encode()):
            return _forbidden(
                "This page needs the whole address that tjscan printed, its token too"
            )
        if not _is_asked_by_own_page(address, request.headers):
            return _forbidden("This page answers under its own address alone, to its own page")
        return answer(connection, replace(request, path=f"/{rest}"))

    return answer_with_token


def _forbidden(reason: str) -> Response:
    body = f"{reason}.\n".encode()
    head = Headers({"Content-Type": "text/plain", "Content-Length": str(len(body))})
    return Response(HTTPStatus.FORBIDDEN, "Forbidden", head, body)


def _is_asked_by_own_page(address: str, headers: Headers) -> bool:
    """Whether a browser asks under a name of this server, from a page of this server if from any.

    A page of another site may make a browser ask, and a name that leads here may be anyone's.
    """
    hosts, origins = headers.get_all("Host"), headers.get_all("Origin")
    try:
        named = [urlsplit(f"//{host}").hostname or "" for host in hosts]
        asked_from = [urlsplit(origin).netloc for origin in origins]
    except ValueError:  # no address at all
        return False
    if len(hosts) != 1 or any(one != hosts[0] for one in asked_from):
        return False
    return not is_loopback_host(address) or is_loopback_host(named[0])
