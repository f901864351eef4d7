"""Faces in fields: what the laws that act on faces share."""

import numpy as np
import taichi as ti

from sandbox.forces.faces import incident_faces
from sandbox.forces.tears import Tears
from sandbox.scene.surfaces import FaceSet
from sandbox.state import ParticleState, place


@ti.data_oriented
class FaceFields:
    """F faces and, of every particle, those that it belongs to. Without tears, what they need is not compiled.

    Attributes
    ----------
    row : start of every particle's entries, shape (particle_count + 1,)
    entry : face of every entry, shape (d F,)
    corners : particles of every face, vectors, shape (F,)
    """

    def __init__(self, builder: ti.FieldsBuilder, faces: FaceSet, state: ParticleState, tears: Tears | None) -> None:
        self.faces = faces
        self.tears = tears
        self.tearing = tears is not None
        self.dimension = state.dimension
        self.count, self.edge_count = faces.springs.shape
        self.rows = incident_faces(faces.faces, state.count)
        self.row = place(builder, ti.field(ti.i32), state.count + 1)
        self.entry = place(builder, ti.field(ti.i32), len(self.rows.face))
        self.corners = place(builder, ti.Vector.field(self.dimension, ti.i32), self.count)
        if self.tearing:
            self.spring = place(builder, ti.Vector.field(self.edge_count, ti.i32), self.count)

    def load(self) -> None:
        """Upload everything."""
        faces = self.faces
        self._write(
            self.rows.row, self.rows.face, np.ascontiguousarray(faces.faces), np.ascontiguousarray(faces.springs)
        )

    @ti.func
    def is_torn(self, f) -> ti.i32:
        """1 where an edge of face f has torn."""
        torn = 0
        for edge in ti.static(range(self.edge_count)):
            s = self.spring[f][edge]
            if s >= 0:
                if self.tears.torn[s] != 0:
                    torn = 1
        return torn

    @ti.kernel
    def _write(
        self, row: ti.types.ndarray(), entry: ti.types.ndarray(), face: ti.types.ndarray(), spring: ti.types.ndarray()
    ):
        for i in range(row.shape[0]):
            self.row[i] = row[i]
        for h in range(entry.shape[0]):
            self.entry[h] = entry[h]
        for f in range(face.shape[0]):
            for corner in ti.static(range(self.dimension)):
                self.corners[f][corner] = face[f, corner]
            if ti.static(self.tearing):
                for edge in ti.static(range(self.edge_count)):
                    self.spring[f][edge] = spring[f, edge]
