"""Who may see a served scene: a token where it is open to others, and pages of this server only."""

import hmac
import ipaddress
import re
import secrets
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from urllib.parse import parse_qs, urlsplit

from sandbox.errors import SceneError

_PLAIN = re.compile(r"[A-Za-z0-9._~-]{8,128}")


class Verdict(Enum):
    """What is to become of a request."""

    LET_IN = "let in"
    GIVE_COOKIE = "give cookie"
    """The token came in the address: it is put away in a cookie, and the page opened again without it."""
    NO_TOKEN = "no token"
    STRANGE_PAGE = "strange page"
    """A page of another server asks, or this one under a name that is not its own."""


@dataclass(frozen=True)
class Asked:
    """What of a request matters here: its path with the query, and headers, each as often as it came."""

    path: str
    hosts: Sequence[str] = ()
    origins: Sequence[str] = ()
    cookies: Sequence[str] = ()
    is_websocket: bool = False


@dataclass(frozen=True)
class Access:
    """The rule for every connection, before anything of the scene is sent."""

    host: str
    """Address that the server listens on."""
    token: str | None
    """What a browser must know; None: who reaches a loopback address is let in."""

    @classmethod
    def of(cls, host: str, token: str | None = None) -> "Access":
        """The rule for an address: opened wider than the loopback address it has a token, made up if none is given.

        Raises SceneError where the token is none that fits into an address.
        """
        if token is not None and not _PLAIN.fullmatch(token):
            raise SceneError("--token: must be 8 to 128 letters, digits or any of . _ ~ -")
        if token is None and not is_loopback(host):
            token = secrets.token_urlsafe(16)
        return cls(host, token)

    def judge(self, asked: Asked, port: int) -> Verdict:
        """What is to become of a request that came in on a port."""
        if not self._is_own_page(asked):
            return Verdict.STRANGE_PAGE
        if self.token is None:
            return Verdict.LET_IN
        if any(self._is_token(value) for value in _cookies(asked.cookies, cookie_name(port))):
            return Verdict.LET_IN
        if not any(self._is_token(value) for value in parse_qs(urlsplit(asked.path).query).get("token", [])):
            return Verdict.NO_TOKEN
        return Verdict.LET_IN if asked.is_websocket else Verdict.GIVE_COOKIE

    def cookie(self, port: int) -> str:
        """The header that puts the token away in the browser."""
        return f"{cookie_name(port)}={self.token}; Path=/; HttpOnly; SameSite=Lax"

    def address(self, port: int, shown_host: str | None = None) -> str:
        """What to open in a browser."""
        host = shown_host or self.host
        host = f"[{host}]" if ":" in host else host
        return f"http://{host}:{port}/" + (f"?token={self.token}" if self.token is not None else "")

    def _is_token(self, value: str) -> bool:
        # Bytes that are no text come as what cannot be encoded as it is.
        given = value.encode(errors="backslashreplace")
        return self.token is not None and hmac.compare_digest(given, self.token.encode())

    def _is_own_page(self, asked: Asked) -> bool:
        """False for scripts of other sites, which browsers let open WebSockets anywhere, and for borrowed names."""
        if len(asked.hosts) != 1 or len(asked.origins) > 1:
            return False
        if asked.origins and _host_of(asked.origins[0]) != asked.hosts[0].lower():
            return False
        # Without a token a page could come in by a name of its own that is made to lead here.
        return self.token is not None or is_loopback(_name(asked.hosts[0])) or _name(asked.hosts[0]) == self.host


def is_loopback(host: str) -> bool:
    """True for addresses and names that only this machine reaches."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host.lower() == "localhost"


def cookie_name(port: int) -> str:
    """Name of the cookie that holds the token; browsers do not tell ports apart."""
    return f"sandbox-token-{port}"


def _cookies(headers: Sequence[str], name: str) -> list[str]:
    pairs = [pair.strip().partition("=") for header in headers for pair in header.split(";")]
    return [value for key, _, value in pairs if key == name]


def _host_of(origin: str) -> str | None:
    """Name and port in an Origin header; None where there is none to be found."""
    try:
        return urlsplit(origin).netloc.lower()
    except ValueError:
        return None


def _name(host: str) -> str:
    """A Host header without its port."""
    try:
        return urlsplit(f"//{host}").hostname or ""
    except ValueError:
        return ""
