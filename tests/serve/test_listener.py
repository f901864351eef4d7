"""Who is let in, over real connections: neither the page nor anything of the scene without the token."""

import urllib.error
import urllib.request
from http.cookiejar import CookieJar

import pytest

pytest.importorskip("viser", reason="needs the extra web")

import numpy as np
from websockets.exceptions import InvalidStatus

from sandbox.errors import SceneError
from sandbox.serve.access import Access, cookie_name
from sandbox.serve.listener import open_port, serving
from tests.serve.viewer import Viewer


@pytest.fixture(scope="module")
def guarded():
    """A served secret behind a token, and its port."""
    access = Access.of("0.0.0.0", "a-good-token")
    listening = open_port("127.0.0.1", 0)
    port = listening.getsockname()[1]
    with serving(listening, access) as server:
        server.scene.add_mesh_simple("/secret", np.eye(3), np.array([[0, 1, 2]]))
        yield port


def get(url, **headers):
    """Status and content of a page, with cookies as browsers keep them."""
    opener = urllib.request.build_opener(urllib.request.HTTPCookieProcessor(CookieJar()))
    try:
        with opener.open(urllib.request.Request(url, headers=headers)) as answer:
            return answer.status, answer.read(), answer.url
    except urllib.error.HTTPError as error:
        return error.code, error.read(), url


def cookie(port, token="a-good-token"):
    return {"Cookie": f"{cookie_name(port)}={token}"}


def test_without_the_token_there_is_no_page(guarded):
    for path in ("/", "/index.html", "/?token=wrong-token", "/../index.html", "//", "/?token=a-good-token%00"):
        status, content, _ = get(f"http://127.0.0.1:{guarded}{path}")
        assert (status, b"token is needed" in content) == (401, True)
        assert b"<script" not in content
    assert get(f"http://127.0.0.1:{guarded}/", **cookie(guarded, "wrong"))[0] == 401
    # A claim to be a WebSocket does not help either.
    assert get(f"http://127.0.0.1:{guarded}/", Upgrade="websocket", Connection="Upgrade")[0] == 401


def test_with_the_token_there_is_the_page_and_the_address_forgets_it(guarded):
    status, content, url = get(f"http://127.0.0.1:{guarded}/?token=a-good-token")
    assert status == 200 and b"<script" in content
    assert url == f"http://127.0.0.1:{guarded}/"


@pytest.mark.parametrize("headers", [{}, {"Cookie": "a=b"}, {"Cookie": "sandbox-token-1=a-good-token"}])
def test_without_the_token_there_is_no_websocket(guarded, headers):
    with pytest.raises(InvalidStatus) as refused:
        Viewer(guarded, additional_headers=headers)
    assert refused.value.response.status_code == 401
    assert refused.value.response.body is not None and b"secret" not in bytes(refused.value.response.body)


def test_with_the_token_there_is_the_scene(guarded):
    viewer = Viewer(guarded, additional_headers=cookie(guarded))
    viewer.look_around()
    assert viewer.vertices["/secret"] == pytest.approx(np.eye(3))
    viewer.close()


def test_a_page_of_another_server_may_not_open_a_websocket(guarded):
    with pytest.raises(InvalidStatus) as refused:
        Viewer(guarded, additional_headers=cookie(guarded), origin="http://evil.example")
    assert refused.value.response.status_code == 403


def test_nobody_can_have_the_scene_published(guarded):
    """viser's page has a button that asks for a tunnel to a public address."""
    from viser import _messages

    viewer = Viewer(guarded, additional_headers=cookie(guarded))
    viewer.send(_messages.ShareUrlRequest())
    viewer.send(_messages.ShareUrlDisconnect())
    viewer.connection.send(b"\xff not a message")
    other = Viewer(guarded, additional_headers=cookie(guarded))
    other.look_around()
    assert "/secret" in other.vertices
    other.close()


def test_a_port_that_is_taken_is_one_line(guarded):
    with pytest.raises(SceneError, match=f"127.0.0.1, port {guarded}: address already in use"):
        open_port("127.0.0.1", guarded)
    with pytest.raises(SceneError, match="--port 70000"):
        open_port("127.0.0.1", 70000)
    with pytest.raises(SceneError, match="--host no"):
        open_port("no.such.host.invalid", 0)


def test_a_viser_that_cannot_be_guarded_serves_nothing(monkeypatch):
    from viser.infra import _infra
    from websockets.asyncio.server import serve as plain

    from sandbox.errors import SandboxError

    class Elsewhere:
        """A namespace in which the replaced function is not looked up."""

        class asyncio:
            class server:
                serve = plain
                ServerConnection = object

        datastructures, exceptions = _infra.websockets.datastructures, _infra.websockets.exceptions

    monkeypatch.setattr(_infra, "websockets", Elsewhere)
    listening = open_port("127.0.0.1", 0)
    with pytest.raises(SandboxError, match="cannot be guarded"), serving(listening, Access.of("127.0.0.1")):
        pass
    assert listening.fileno() == -1
