"""Nobody reaches the page without its token, and nobody from another machine."""

import socket
from collections.abc import Iterator
from contextlib import suppress
from urllib.error import HTTPError
from urllib.request import Request, urlopen

import pytest
from _live_client import page_client
from websockets.exceptions import ConnectionClosed, InvalidStatus

from tjscan.core.errors import PageUnavailable
from tjscan.live.access import LOOPBACK_ADDRESS, status_without_token
from tjscan.live.page import Page, PageAddress
from tjscan.live.step import SceneSetup


@pytest.fixture(scope="module")
def page() -> Iterator[Page]:
    with Page([SceneSetup("nothing")], PageAddress(port=0)) as shown:
        yield shown


def test_the_whole_address_opens_the_page(page: Page) -> None:
    with urlopen(page.url) as answer:
        assert b"<html" in answer.read()[:300].lower()
    with page_client(page) as client:
        assert client.receive() > 0


def test_without_the_token_page_and_socket_are_refused(page: Page) -> None:
    port = page.server.get_port()
    assert status_without_token(LOOPBACK_ADDRESS, port) == 403
    for path in ("", "guess", page.token[:-1], f"x/{page.token}"):
        with (
            pytest.raises(InvalidStatus, match="403"),
            page_client(page, f"http://{LOOPBACK_ADDRESS}:{port}/{path}"),
        ):
            pass


def test_two_pages_have_two_tokens(page: Page) -> None:
    with Page([SceneSetup("nothing")], PageAddress(port=0)) as other:
        assert other.token != page.token


def test_it_is_bound_to_this_machine_alone(page: Page) -> None:
    bound = page.server._websock_server
    assert bound is not None
    assert page.server.get_host() == LOOPBACK_ADDRESS
    with socket.socket() as other:
        other.settimeout(1)
        # The whole net 127/8 is this machine's; another address of it must find nothing there.
        assert other.connect_ex(("127.0.0.2", page.server.get_port())) != 0


def test_a_port_that_is_taken_is_not_exchanged_for_another(page: Page) -> None:
    with pytest.raises(PageUnavailable, match=r"can't be had.*--port"):
        Page([SceneSetup("nothing")], PageAddress(port=page.server.get_port()))


def test_an_address_of_another_machine_is_refused() -> None:
    with pytest.raises(PageUnavailable, match=r"192\.0\.2\.1"):
        Page([SceneSetup("nothing")], PageAddress(port=0, address="192.0.2.1"))


def test_nothing_is_printed(capfd: pytest.CaptureFixture[str]) -> None:
    with Page([SceneSetup("nothing")], PageAddress(port=0)):
        pass
    assert capfd.readouterr() == ("", "")


def test_nobody_makes_it_public_through_a_relay(page: Page) -> None:
    page.server.request_share_url()
    assert page.server._share_tunnel is None


@pytest.mark.parametrize(
    "headers",
    [
        {"Origin": "https://elsewhere.example"},
        {"Host": "elsewhere.example"},
        {"Origin": "null"},
        {"Host": "[::1"},
        {"Origin": "http://["},
    ],
)
def test_pages_of_other_sites_are_refused_even_with_the_token(
    page: Page, headers: dict[str, str]
) -> None:
    with pytest.raises(HTTPError, match="403"):
        urlopen(Request(page.url, headers=headers))


def test_a_page_asked_by_its_own_origin_is_shown(page: Page) -> None:
    origin = f"http://localhost:{page.server.get_port()}"
    headers = {"Origin": origin, "Host": origin.removeprefix("http://")}
    with urlopen(Request(page.url, headers=headers)) as answer:
        assert answer.status == 200


def test_what_is_no_message_prints_nothing(page: Page, capfd: pytest.CaptureFixture[str]) -> None:
    for wrong in (b"\x00\xff garbage", "text", b"\x81\xa4type\xa4none"):
        with page_client(page) as client:
            client.socket.send(wrong)
            with suppress(ConnectionClosed):
                client.receive()
    assert capfd.readouterr() == ("", "")
