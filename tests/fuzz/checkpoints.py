"""Checkpoints with bits flipped, members rewritten, and heads that claim what is not there."""

import functools
import io
import pickle
import tempfile
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import strategies as st

from sandbox import Simulation, checkpoint
from sandbox.scene.assemble import assemble
from sandbox.scene.load import scene_from_data, to_toml
from tests.fuzz import odd, seeds
from tests.fuzz.inputs import Input, Kind, Wrong, start_taichi
from tests.fuzz.scene_files import checked

_SOFT = {"stiffness": 500.0, "damping_ratio": 0.1, "mass": 2.0}
SCENE = {
    **{key: seeds.FLAT[key] for key in ("dimension", "gravity", "render")},
    "solver": {"dt": 1e-3, "precision": "f64"},
    "bodies": [
        {
            "name": "box", "position": [0.0, 2.0], "material": {**_SOFT, "yield_strain": 0.1},
            "shape": {"kind": "box", "size": [0.6, 0.4], "cells": [3, 2]},
        },
        {
            "name": "ring", "position": [2.0, 2.0], "material": _SOFT,
            "pressure": {"gauge_pressure": 500.0, "leak": 0.1},
            "shape": {"kind": "ring", "radius": 0.3, "segments": 10},
        },
    ],
    "actions": [{"kind": "push", "start": 0.01, "end": 0.05, "body": "box", "force": [1.0, 0.0]}],
}  # fmt: skip
"""Few bodies with something to remember beside their places."""
_SHAPES = (
    (),
    (0,),
    (1,),
    (3,),
    (3, 2),
    (25, 2),
    (25, 3),
    (10**12, 2),
    (10**18,),
    (-1, 2),
    (2**31, 2**31),
    (1,) * 32,
    (2**62, 4),
)
_TYPES = (
    "<f8",
    ">f8",
    "<f4",
    "<f2",
    "<c16",
    "<i8",
    "|b1",
    "|O",
    "<U7",
    "|S9",
    "<M8[s]",
    "|V16",
    "<f16",
    "|u1",
    "<U99999999",
)


@functools.cache
def _simulation() -> Simulation:
    """The simulation that checkpoints are of, and that goes on from those that are taken."""
    simulation = Simulation(scene_from_data(SCENE, None), threads=1)
    simulation.advance(0.03)
    return simulation


@functools.cache
def _members() -> dict[str, bytes]:
    """Name and content of what a checkpoint has in it."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "checkpoint.npz"
        _simulation().save(path)
        with zipfile.ZipFile(path) as archive:
            return {name: archive.read(name) for name in archive.namelist()}


def _zipped(members: dict[str, bytes], compression: int = zipfile.ZIP_DEFLATED) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", compression) as archive:
        for name, data in members.items():
            archive.writestr(zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0)), data, compression)
    return buffer.getvalue()


def _array(values: Any) -> bytes:
    buffer = io.BytesIO()
    np.lib.format.write_array(buffer, np.asarray(values), allow_pickle=True)
    return buffer.getvalue()


def _headed(shape: tuple[int, ...], kind: str, order: bool, data: bytes) -> bytes:
    """An array's file with a head that says anything."""
    head = repr({"descr": kind, "fortran_order": order, "shape": shape}).encode() + b"\n"
    return b"\x93NUMPY\x01\x00" + len(head).to_bytes(2, "little") + head + data


@st.composite
def _rewritten(draw: Any) -> bytes:
    members = dict(_members())
    for _ in range(draw(st.sampled_from([1, 1, 2]))):
        name = draw(st.sampled_from(sorted(_members().keys() & members.keys())))
        match draw(st.sampled_from("damage head value scene state gone more pickle".split())):
            case "damage":
                members[name] = odd.damaged(draw, members[name])
            case "head":
                shape, kind = draw(st.sampled_from(_SHAPES)), draw(st.sampled_from(_TYPES))
                members[name] = _headed(shape, kind, draw(st.booleans()), members[name][128:])
            case "value":
                members[name] = _value(draw)
            case "scene":
                text = odd.toml(draw(odd.changed((SCENE,), most=2))).decode("utf-8", "replace")
                members["scene.npy"] = _array(text)
            case "state":
                members[name] = _changed_numbers(draw, _members().get(name, members[name]))
            case "gone":
                del members[name]
            case "more":
                members[draw(st.sampled_from(["memory.x.npy", "memory..npy", "x", "../x.npy", "a" * 200]))] = _value(
                    draw
                )
            case "pickle":
                members[name] = _array(np.array([print], dtype=object)) if draw(st.booleans()) else pickle.dumps(print)
        if not _members().keys() & members.keys():
            break
    return _zipped(members, draw(st.sampled_from([zipfile.ZIP_DEFLATED, zipfile.ZIP_STORED, zipfile.ZIP_LZMA])))


def _value(draw: Any) -> bytes:
    value = draw(st.one_of(st.sampled_from(odd.NUMBERS), st.sampled_from(odd.TEXTS)))
    if draw(st.booleans()):
        return _array(value if isinstance(value, str) else np.float64(min(max(value, -1e308), 1e308)))
    count = draw(st.sampled_from([0, 1, 25, 10_000]))
    return _array(np.full((count, 2), min(max(value, -1e308), 1e308) if not isinstance(value, str) else 1.0))


def _changed_numbers(draw: Any, data: bytes) -> bytes:
    """An array with a few of its numbers changed to odd ones."""
    values = np.lib.format.read_array(io.BytesIO(data))
    if values.dtype != np.float64 or values.size == 0:
        return data
    flat = values.reshape(-1).copy()
    for _ in range(draw(st.sampled_from([1, 3]))):
        number = draw(st.sampled_from(odd.NUMBERS))
        flat[draw(st.integers(0, flat.size - 1))] = min(max(number, -1e308), 1e308)
    return _array(flat.reshape(values.shape))


def _drawn() -> Any:
    whole = _zipped(_members())
    rewritten = _rewritten()
    return st.one_of(rewritten, rewritten, odd.broken([whole])).map(lambda data: Input(".npz", data))


def _take(path: Path) -> None:
    """Read it; go on from it for a few steps where it is of the scene that is at hand."""
    saved = checkpoint.read(path)
    simulation = _simulation()
    if to_toml(saved.scene) != to_toml(simulation.scene):
        assembly = checked(saved.scene)
        if assembly is not None and assembly.particle_count != len(saved.positions):
            assemble(saved.scene)
        return
    simulation.resume(saved)
    simulation.advance(0.01)
    if not (np.isfinite(simulation.positions()).all() and np.isfinite(simulation.velocities()).all()):
        raise Wrong("went on to a state that is not finite")


CHECKPOINTS = Kind("checkpoints", _drawn, _take, short=60, prepare=start_taichi)
