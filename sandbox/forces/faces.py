"""Faces as particles see them: of every particle the faces that it belongs to, in compressed rows. NumPy only.

What acts on a face is passed to its corners. Each particle gathers its own share over its row, so
that no two threads write to one place, and the order of the sum never changes.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

IntArray = NDArray[np.int32]


@dataclass(frozen=True)
class FaceRows:
    """F faces (2D: edges, 3D: triangles) by particle. Every face stands in the rows of its d corners."""

    row: IntArray
    """Start of every particle's entries, shape (particle_count + 1,)."""
    face: IntArray
    """Face of every entry, rising within a row, shape (d F,)."""


def incident_faces(faces: IntArray, particle_count: int) -> FaceRows:
    """Rows of faces, shape (F, d) with d = 2 or 3."""
    count, corners = faces.shape
    owner = faces.T.reshape(-1)
    face = np.tile(np.arange(count), corners)
    by_row = np.lexsort((face, owner))
    row = np.concatenate([[0], np.cumsum(np.bincount(owner, minlength=particle_count))])
    return FaceRows(row=row.astype(np.int32), face=face[by_row].astype(np.int32))
