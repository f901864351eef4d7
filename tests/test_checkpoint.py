"""Checkpoints that are damaged, or that nobody can have written: one line, at once and without much memory."""

import zipfile
from dataclasses import replace

import numpy as np
import pytest

from sandbox import SceneError, checkpoint
from tests.conftest import make_scene

COUNT = 7


@pytest.fixture
def saved():
    points = [[0.1 * k, 0.3] for k in range(COUNT)]
    shape = {"kind": "custom", "points": points, "masses": [1.0] * COUNT}
    scene = make_scene(dimension=2, bodies=[{"name": "dust", "shape": shape}])
    velocities = np.random.default_rng(1).normal(size=(COUNT, 2))
    return checkpoint.Checkpoint(
        scene, 0.25, np.array(points), velocities, velocities, "cpu", "f64", (1e-3, 1e-3, 0.0, 0.0), {"a": np.ones(3)}
    )


def test_what_is_written_is_read(saved, tmp_path):
    checkpoint.write(tmp_path / "c.npz", saved)
    found = checkpoint.read(tmp_path / "c.npz")
    assert (found.scene, found.time, found.steps) == (saved.scene, saved.time, saved.steps)
    assert np.array_equal(found.velocities, saved.velocities) and np.array_equal(found.memory["a"], saved.memory["a"])


@pytest.mark.parametrize(
    "change",
    [
        {"time": -1.0}, {"time": np.nan}, {"time": np.inf}, {"steps": (-1e-3, 1e-3, 0.0, 0.0)}, {"steps": (np.nan,)},
        {"steps": (np.inf,)},
        {"steps": (1e-3,)}, {"steps": (1e-3,) * 5}, {"time": 1e16}, {"positions": np.full((COUNT, 2), -1e16)},
        {"positions": np.full((COUNT, 2), np.nan)}, {"positions": np.zeros((COUNT, 3))},
        {"velocities": np.full((COUNT, 2), np.inf)}, {"velocities": np.zeros((COUNT - 1, 2))},
        {"force_velocities": np.zeros((COUNT, 0))}, {"positions": np.array(1.0)},
    ],
    ids=str,
)  # fmt: skip
def test_states_that_no_run_leaves_are_refused(change, saved, tmp_path):
    checkpoint.write(tmp_path / "c.npz", replace(saved, **change))
    with pytest.raises(SceneError, match=r"c\.npz: is not a checkpoint, or is damaged"):
        checkpoint.read(tmp_path / "c.npz")


def test_any_bit_may_be_flipped_and_any_end_be_missing(saved, tmp_path):
    path = tmp_path / "c.npz"
    checkpoint.write(path, saved)
    data = path.read_bytes()
    refused = 0
    for place in range(0, 8 * len(data), 61):
        changed = bytearray(data)
        changed[place // 8] ^= 1 << place % 8
        path.write_bytes(changed)
        try:
            assert len(checkpoint.read(path).positions) == COUNT  # a bit that means nothing
        except SceneError as error:
            assert len(str(error)) < 300
            refused += 1
    assert refused > 0.5 * 8 * len(data) / 61
    for end in range(0, len(data), 97):
        path.write_bytes(data[:end])
        with pytest.raises(SceneError):
            checkpoint.read(path)


def rewritten(path, name, content):
    """Replace a part of an archive."""
    with zipfile.ZipFile(path) as archive:
        parts = {part: archive.read(part) for part in archive.namelist()}
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for part, data in {**parts, name: content}.items():
            archive.writestr(part, data)


@pytest.mark.parametrize("head", [b"{'descr': '<f8', 'shape': (7, 2", b"{'descr': \n'<f8", b"(" * 300, b"\0" * 40])
def test_heads_that_are_no_python(head, saved, tmp_path):
    path = tmp_path / "c.npz"
    checkpoint.write(path, saved)
    rewritten(path, "positions.npy", b"\x93NUMPY\x01\x00" + len(head).to_bytes(2, "little") + head)
    with pytest.raises(SceneError, match="is not a checkpoint, or is damaged"):
        checkpoint.read(path)


@pytest.mark.parametrize("rows", [10**12, 10**18, -1])
def test_rows_that_a_head_only_claims(rows, saved, tmp_path):
    path = tmp_path / "c.npz"
    checkpoint.write(path, saved)
    with zipfile.ZipFile(path) as archive:
        whole = archive.read("positions.npy")
    # A head is padded with blanks.
    old, new = f"({COUNT}, 2), }}".encode(), f"({rows}, 2), }}".encode()
    assert old in whole
    rewritten(path, "positions.npy", whole.replace(old + b" " * (len(new) - len(old)), new.ljust(len(old))))
    with pytest.raises(SceneError, match="is not a checkpoint, or is damaged"):
        checkpoint.read(path)


def test_a_file_that_unpacks_to_a_gigabyte_is_refused_by_its_head(saved, tmp_path):
    path = tmp_path / "c.npz"
    checkpoint.write(path, saved)
    rewritten(path, "memory.b.npy", bytes(1 << 28))
    assert path.stat().st_size < 1 << 20
    with pytest.raises(SceneError, match="is not a checkpoint, or is damaged"):
        checkpoint.read(path)


def test_pickles_are_not_loaded(tmp_path):
    np.savez(tmp_path / "c.npz", format=np.array([print], dtype=object))
    with pytest.raises(SceneError, match="is not a checkpoint, or is damaged"):
        checkpoint.read(tmp_path / "c.npz")
