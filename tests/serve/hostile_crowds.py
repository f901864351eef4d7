"""Hostile clients as in :mod:`tests.serve.hostile`: those that come with many connections, or strange requests."""

import contextlib
import socket
import struct
import time

import viser

from sandbox.serve import limits
from tests.serve.hostile import hostile
from tests.serve.target import camera, frame, pack

PAGE = b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"

# -- connections ------------------------------------------------------------------------------------


@hostile
def opens_300_browsers(target):
    links = []
    for _ in range(300):
        links.append(socket.create_connection(("127.0.0.1", target.port), timeout=5.0))
        links[-1].sendall(target.handshake())
    answers = []
    for link in links:
        with contextlib.suppress(OSError):
            answers.append(link.recv(100)[9:12])
    assert 0 < answers.count(b"101") <= limits.CLIENTS
    for link in links:
        link.close()


@hostile
def opens_300_connections_and_says_nothing(target):
    links = [socket.create_connection(("127.0.0.1", target.port), timeout=5.0) for _ in range(300)]
    # Somebody else is served meanwhile.
    assert b"200 OK" in target.raw(PAGE, wait=1.0)
    for link in links:
        link.close()


@hostile
def shakes_hands_byte_by_byte(target):
    links = [socket.create_connection(("127.0.0.1", target.port), timeout=5.0) for _ in range(80)]
    for byte in target.handshake()[:20]:
        for link in links:
            with contextlib.suppress(OSError):
                link.sendall(bytes([byte]))
    assert b"200 OK" in target.raw(PAGE, wait=1.0)
    for link in links:
        link.close()


@hostile
def leaves_connections_half_open(target):
    for _ in range(50):
        link = target.open()
        link.shutdown(socket.SHUT_WR)
        link.close()
    for _ in range(50):
        link = target.open()
        link.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        link.close()


def _never_reads(target, count, sent, seconds):
    """Connections that ask for something, and take next to nothing of it for a while."""
    links = []
    for _ in range(count):
        link = socket.socket()
        link.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 12)
        link.connect(("127.0.0.1", target.port))
        link.sendall(sent)
        links.append(link)
    time.sleep(seconds)
    for link in links:
        link.close()


@hostile
def looks_and_never_reads(target):
    _never_reads(target, 10, target.handshake() + frame(2, pack(camera())), 1.0)


@hostile
def fetches_the_page_and_never_reads(target):
    _never_reads(target, 60, PAGE, 0.5)


@hostile
def comes_and_goes_1_000_times(target):
    for _ in range(1000):
        target.open().close()


@hostile
def floods_from_30_connections_each_within_its_limits(target):
    links = [target.open() for _ in range(30)]
    message = frame(2, pack(camera()))
    for turn in range(10):
        for link in links:
            with contextlib.suppress(OSError):
                link.sendall(message * (limits.MESSAGES // 10))
        if turn == 5:
            # Somebody else is served meanwhile.
            start = time.perf_counter()
            assert b"200 OK" in target.raw(PAGE, wait=5.0) and time.perf_counter() - start < 5.0
        time.sleep(0.1)
    for link in links:
        link.close()


# -- requests ---------------------------------------------------------------------------------------


@hostile
def asks_for_files_elsewhere(target):
    paths = ("/../../../../etc/passwd", "/%2e%2e/%2e%2e/etc/passwd", "/..%5c..%5cetc/passwd", "//etc/passwd", "/\0")
    paths += ("/%00", "/" + "a" * 5000, "/" + "%2e%2e/" * 500, "*", "http://elsewhere/", "/?token=\xff", "/\x1b[31m")
    for path in paths:
        answer = target.raw(f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n".encode("latin-1"), wait=0.5)
        assert b"root:" not in answer


@hostile
def sends_giant_requests(target):
    target.raw(b"GET /" + b"a" * (1 << 22), wait=0.1)
    target.raw(b"GET / HTTP/1.1\r\n" + b"X: " + b"a" * (1 << 22), wait=0.1)
    target.raw(b"GET / HTTP/1.1\r\n" + b"X: y\r\n" * (1 << 18), wait=0.1)


@hostile
def posts_and_speaks_other_protocols(target):
    for method in (b"POST", b"PUT", b"CONNECT", b"\x1b[31m"):
        target.raw(method + b" / HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 1000000000\r\n\r\n" + bytes(10_000))
    target.raw(b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" + bytes(500))
    target.raw(b"SSH-2.0-hostile\r\n")
    target.raw(b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nTransfer-Encoding: chunked\r\n\r\nffffffff\r\n")


@hostile
def forges_hosts_and_origins(target):
    for header in ("Origin: http://evil.example", "Origin: null", "Origin: http://[", "Origin: a\r\nOrigin: b"):
        assert b"403" in target.raw(target.handshake(header), wait=1.0)
    for host in ("evil.example", "[", "127.0.0.1\r\nHost: evil.example"):
        assert b"403" in target.raw(f"GET / HTTP/1.1\r\nHost: {host}\r\n\r\n".encode(), wait=1.0)


@hostile
def guesses_tokens_500_times(target):
    for number in range(500):
        with socket.create_connection(("127.0.0.1", target.port), timeout=5.0) as link:
            link.sendall(f"GET /?token={number} HTTP/1.1\r\nHost: evil\r\nCookie: sandbox-token=\xff\r\n\r\n".encode())


@hostile
def is_a_page_of_another_version(target):
    for version in ("\x1b[31mred", "0.0.0", f"{viser.__version__} x", "", "x" * 5000):
        request = target.handshake().replace(viser.__version__.encode(), version.encode())
        target.raw(request, frame(2, pack(camera())), wait=0.1)
    target.raw(target.handshake().replace(b"Upgrade: websocket", b"Upgrade: other\r\nUpgrade: websocket"))
