"""The command serve: its mistakes in one line each, and its end."""

import importlib.util
import socket
import tomllib

import pytest

from sandbox.serve import app

needs_viser = pytest.mark.skipif(importlib.util.find_spec("viser") is None, reason="needs the extra web")


@needs_viser
@pytest.mark.parametrize(
    ("message", "options"),
    [
        ("--token: must be 8 to 128", ["--token", "short"]),
        ("--port 70000: must be between 0 and 65535", ["--port", "70000"]),
        ("--host no.such.host.invalid: there is no such address", ["--host", "no.such.host.invalid"]),
        ("--seconds -1: must be > 0", ["--seconds", "-1"]),
        ("--clients 0: must be between 1 and 256", ["--clients", "0"]),
        ("--pictures 0: must be between 1 and 240", ["--pictures", "0"]),
        ("--record nowhere/done.toml: there is no folder nowhere", ["--record", "nowhere/done.toml"]),
        ("bodies[0].nonsense", ["--set", "bodies.0.nonsense=1"]),
    ],
)
def test_a_mistake_is_one_line_and_nothing_is_served(refuses, message, options):
    refuses(message, "serve", "drop_2d", *options)


@needs_viser
def test_a_port_that_is_taken_is_one_line(refuses):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        refuses(f"127.0.0.1, port {port}: address already in use", "serve", "drop_2d", "--port", port)


def test_without_the_extra_it_says_what_to_install(refuses, monkeypatch):
    monkeypatch.setattr(app, "find_spec", lambda name: None)
    refuses("serve needs viser: pip install 'softbody-sandbox[web]'", "serve", "drop_2d")


@needs_viser
def test_it_ends_by_itself_and_leaves_the_recording(run_cli, monkeypatch, tmp_path):
    monkeypatch.setenv("SANDBOX_TOKEN", "from-the-environment")
    record = tmp_path / "done.toml"
    code, printed, errors = run_cli("serve", "drop_2d", "--port", "0", "--seconds", "0.2", "--record", record)
    assert (code, errors) == (0, "")
    address, end = printed.splitlines()
    assert address.startswith("open http://127.0.0.1:") and "?token=from-the-environment" in address
    assert str(record) in end
    # Nobody looked: no time went by.
    assert tomllib.loads(record.read_text())["recording"]["ticks"] == 0


def test_help_names_the_limits(run_cli):
    code, printed, _ = run_cli("serve", "--help")
    words = " ".join(printed.split())
    assert code == 0
    for limit in ("32 browsers at once (--clients)", "400 messages a second", "64 KB", "8 clicks on Step"):
        assert limit in words
