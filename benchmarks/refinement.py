"""How stiff a lattice is by its cells across, pulled and bent, against elasticity.

Run ``python benchmarks/refinement.py [N ...]``. A bar of springs, as scenes have them, is held along its length at one
end and loaded at the other: by an even pull, or by a couple. Elasticity has both in closed form: strain F / (E A),
curvature M / (E I) (Timoshenko and Goodier 1951, section 102). Displacements are those of small strains, from the
springs' own stiffness matrix. With --engine the bar of the first number of cells also sags under its own weight in the
engine itself, damped to rest by implicit steps, and by that matrix.
"""

import sys
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import spsolve

import sandbox
from sandbox.scene.assemble import Assembly, assemble

FloatArray = NDArray[np.float64]

LENGTH, HEIGHT = 2.0, 0.25  # m
MODULUS, DENSITY = 1e6, 100.0  # Pa, kg/m^3
MOST_SOLID = 8  # cells across in 3D; more take minutes
WEIGHT = 0.02  # m/s^2: it bends the bar by little, as the matrix takes it


@dataclass(frozen=True)
class Bar:
    """A bar along x with so many cells, squares or cubes, across its height."""

    dimension: int
    cells: int

    @cached_property
    def scene(self) -> sandbox.Scene:
        """The bar, held at x = 0, under its own weight along y."""
        size = [LENGTH, HEIGHT, HEIGHT][: self.dimension]
        corner = [1e-6, *(HEIGHT for _ in size[1:])]
        body = {
            "name": "bar",
            "position": [LENGTH / 2, *(0.0 for _ in size[1:])],
            "shape": {"kind": "box", "size": size, "cells": [round(x / HEIGHT * self.cells) for x in size]},
            "material": {"youngs_modulus": MODULUS, "density": DENSITY, "damping_ratio": 0.0},
            "pin": {"region": {"min": [-x for x in corner], "max": corner}},
        }
        return sandbox.Scene.model_validate(
            {
                "dimension": self.dimension,
                "gravity": [0.0, -WEIGHT, 0.0][: self.dimension],
                "drag": 12.0,
                "bodies": [body],
                "solver": {"integrator": "implicit_euler", "dt": 0.1, "precision": "f64"},
            }
        )

    @cached_property
    def assembly(self) -> Assembly:
        return assemble(self.scene)

    @cached_property
    def points(self) -> FloatArray:
        """Particles at rest [m], shape (N, d)."""
        return self.assembly.positions

    @property
    def area(self) -> float:
        """Of the cross-section [m^2]; 2D bodies are 1 m thick."""
        return HEIGHT if self.dimension == 2 else HEIGHT**2

    @property
    def second_moment(self) -> float:
        """Second moment of the cross-section [m^4]."""
        return self.area * HEIGHT**2 / 12.0

    @cached_property
    def matrix(self) -> sparse.csr_array:
        """Stiffness matrix of the springs at rest [N/m], shape (N d, N d)."""
        springs, dimension = self.assembly.spring_set, self.dimension
        a, b = springs.ends.T
        along = self.points[b] - self.points[a]
        along /= np.linalg.norm(along, axis=1)[:, None]
        rows = np.repeat(np.arange(len(springs)), 2 * dimension)
        columns = np.concatenate([dimension * e[:, None] + np.arange(dimension) for e in (a, b)], axis=1)
        stretch = sparse.csr_array((np.hstack([-along, along]).ravel(), (rows, columns.ravel())))
        return sparse.csr_array(stretch.T @ sparse.diags_array(springs.stiffness) @ stretch)

    def displaced(self, forces: FloatArray, held: NDArray[np.bool_]) -> FloatArray:
        """Displacements [m] under forces [N] of what is not held, all of shape (N, d)."""
        free = np.nonzero(~held.ravel())[0]
        found = np.zeros(forces.size)
        found[free] = spsolve(self.matrix[free][:, free].tocsc(), forces.ravel()[free])
        return found.reshape(forces.shape)

    def end_loaded(self, pressure: FloatArray) -> FloatArray:
        """Displacements [m] under forces along x at the far end in proportion to a pressure, shape (N,)."""
        x = self.points
        share = np.prod(np.where(np.abs(x[:, 1:]) > 0.499 * HEIGHT, 0.5, 1.0), axis=1) * (x[:, 0] > LENGTH - 1e-9)
        forces = np.zeros_like(x)
        forces[:, 0] = pressure * share
        held = np.zeros(x.shape, dtype=bool)
        held[:, 0] = x[:, 0] < 1e-9
        # What is left are rigid motions: one particle holds all, in 3D another keeps the bar from turning about itself.
        corner = np.lexsort((*x.T[::-1],))[0]
        held[corner] = True
        if self.dimension == 3:
            held[np.lexsort((-x[:, 2], x[:, 1], x[:, 0]))[0], 1] = True
        return self.displaced(forces, held)

    def pulled(self) -> float:
        """Stiffness in tension over E A, less one [1]."""
        moved = self.end_loaded(np.ones(len(self.points)))
        count = self.cells ** (self.dimension - 1)
        strain = (moved[self.points[:, 0] > LENGTH - 1e-9, 0]).mean() / LENGTH
        return count / (MODULUS * self.area * strain) - 1.0

    def bent(self) -> float:
        """Stiffness in bending over E I, less one [1]."""
        x = self.points
        moved = self.end_loaded(-x[:, 1])
        ends = np.abs(x[:, 1]) > 0.499 * HEIGHT
        far = x[:, 0] > LENGTH - 1e-9
        share = np.where(ends, 0.5, 1.0)
        if self.dimension == 3:
            share = share * np.where(np.abs(x[:, 2]) > 0.499 * HEIGHT, 0.5, 1.0)
        moment = (share * x[:, 1] ** 2)[far].sum()
        low, middle, high = (moved[np.abs(x[:, 0] - part * LENGTH) < 1e-9, 1].mean() for part in (0.25, 0.5, 0.75))
        curvature = (low - 2.0 * middle + high) / (0.25 * LENGTH) ** 2
        return moment / (MODULUS * self.second_moment * curvature) - 1.0

    def sag(self) -> float:
        """How far the far end sinks under the weight, held at the other [m]."""
        forces = np.zeros_like(self.points)
        forces[:, 1] = -WEIGHT * self.assembly.masses
        held = np.repeat(self.points[:, :1] < 1e-9, self.dimension, axis=1)
        moved = self.displaced(forces, held)
        return -float(moved[self.points[:, 0] > LENGTH - 1e-9, 1].mean())

    def settled(self) -> float:
        """The same of the engine, once it has come to rest [m]."""
        with sandbox.Simulation(self.scene) as simulation:
            start = simulation.positions()
            simulation.advance(12.0)
            moved = simulation.positions() - start
        return -float(moved[start[:, 0] > LENGTH - 1e-9, 1].mean())

    def sag_of_a_beam(self) -> float:
        """The same of a beam, q L^4 / (8 E I) + q L^2 / (2 kappa G A) with kappa = 5/6 [m]."""
        load = DENSITY * self.area * WEIGHT
        shear = MODULUS / (2.0 * (1.0 + (1.0 / 3.0 if self.dimension == 2 else 0.25)))
        bending = load * LENGTH**4 / (8.0 * MODULUS * self.second_moment)
        return bending + load * LENGTH**2 / (2.0 * 5.0 / 6.0 * shear * self.area)


def main(words: list[str]) -> None:
    """One line a dimension and number of cells across."""
    counts = [int(word) for word in words if word.isdigit()] or [1, 2, 3, 4, 8, 16]
    print("cells across  stiffness pulled    bent   times n^2  deflection")
    for dimension in (2, 3):
        for cells in counts if dimension == 2 else [count for count in counts if count <= MOST_SOLID]:
            bar = Bar(dimension, cells)
            pull, bend = bar.pulled(), bar.bent()
            far = 1.0 / (1.0 + bend) - 1.0
            print(
                f"{dimension}D {cells:9d} {100 * pull:+16.4f} % {100 * bend:+7.2f} % {bend * cells**2:9.3f} "
                f"{100 * far:+10.2f} %",
                flush=True,
            )
    for dimension in (2, 3) if "--engine" in words else ():
        bar = Bar(dimension, counts[0])
        print(
            f"{dimension}D, {counts[0]} cells: sags {bar.settled():.6g} m in the engine, "
            f"{bar.sag():.6g} m by the matrix, {bar.sag_of_a_beam():.6g} m by beam theory"
        )


if __name__ == "__main__":
    main(sys.argv[1:])
