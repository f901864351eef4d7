"""Who is let in, as a rule, before any connection."""

import pytest

from sandbox.errors import SceneError
from sandbox.serve.access import Access, Asked, Verdict, cookie_name

PORT = 8080


def asked(path="/", host="127.0.0.1:8080", **more):
    return Asked(path=path, hosts=[host], **more)


def test_a_loopback_address_needs_no_token():
    for host in ("127.0.0.1", "localhost", "::1", "127.1.2.3"):
        assert Access.of(host).token is None
    assert Access.of("127.0.0.1").judge(asked(), PORT) is Verdict.LET_IN
    assert Access.of("127.0.0.1").address(PORT) == "http://127.0.0.1:8080/"
    assert Access.of("::1").address(PORT) == "http://[::1]:8080/"


def test_what_is_open_wider_has_a_token_of_its_own():
    one, other = Access.of("0.0.0.0"), Access.of("0.0.0.0")
    assert one.token and other.token and one.token != other.token and len(one.token) >= 16
    assert one.address(PORT, "machine") == f"http://machine:8080/?token={one.token}"


def test_the_token_is_asked_for_once_and_then_kept_in_a_cookie():
    access = Access.of("0.0.0.0", "a-good-token")
    cookie = access.cookie(PORT).split(";")[0]
    assert access.judge(asked(), PORT) is Verdict.NO_TOKEN
    assert access.judge(asked("/?token=another-token"), PORT) is Verdict.NO_TOKEN
    assert access.judge(asked("/?token="), PORT) is Verdict.NO_TOKEN
    assert access.judge(asked("/?token=a-good-token"), PORT) is Verdict.GIVE_COOKIE
    assert access.judge(asked("/?token=a-good-token", is_websocket=True), PORT) is Verdict.LET_IN
    assert access.judge(asked(cookies=[f"theme=dark; {cookie}"], is_websocket=True), PORT) is Verdict.LET_IN
    assert access.judge(asked(cookies=[f"{cookie_name(PORT)}=wrong"], is_websocket=True), PORT) is Verdict.NO_TOKEN
    # Cookies know no ports: that of another server on this machine is none of ours.
    assert access.judge(asked(cookies=[cookie]), PORT + 1) is Verdict.NO_TOKEN
    assert {"HttpOnly", "SameSite=Lax"} <= {part.strip() for part in access.cookie(PORT).split(";")}


def test_a_token_may_be_asked_for_on_the_loopback_address_too():
    access = Access.of("127.0.0.1", "a-good-token")
    assert access.judge(asked(), PORT) is Verdict.NO_TOKEN


def test_pages_of_other_servers_are_refused():
    access = Access.of("127.0.0.1")
    strange = asked(origins=["http://evil.example"], is_websocket=True)
    assert access.judge(strange, PORT) is Verdict.STRANGE_PAGE
    assert access.judge(asked(origins=["null"]), PORT) is Verdict.STRANGE_PAGE
    assert access.judge(asked(origins=["http://127.0.0.1:9000"]), PORT) is Verdict.STRANGE_PAGE
    assert access.judge(asked(origins=["http://127.0.0.1:8080"]), PORT) is Verdict.LET_IN
    # A name that its owner makes lead here is not ours.
    borrowed = asked(host="evil.example:8080", origins=["http://evil.example:8080"])
    assert access.judge(borrowed, PORT) is Verdict.STRANGE_PAGE
    assert access.judge(asked(origins=["http://["]), PORT) is Verdict.STRANGE_PAGE
    assert access.judge(Asked("/", hosts=[]), PORT) is Verdict.STRANGE_PAGE
    assert access.judge(Asked("/", hosts=["127.0.0.1", "evil.example"]), PORT) is Verdict.STRANGE_PAGE


def test_bytes_that_are_no_text_are_no_token():
    access = Access.of("127.0.0.1", "a-good-token")
    assert access.judge(asked("/?token=\udcff%ff"), PORT) is Verdict.NO_TOKEN
    assert access.judge(asked(cookies=[f"{cookie_name(PORT)}=\udcff"]), PORT) is Verdict.NO_TOKEN


@pytest.mark.parametrize(
    "token", ["", "short", "with space in it", "line\nbreak-token", "ümlaut-token", "semi;colon-token"]
)
def test_tokens_that_do_not_fit_into_an_address_are_refused(token):
    with pytest.raises(SceneError, match="--token"):
        Access.of("0.0.0.0", token)
