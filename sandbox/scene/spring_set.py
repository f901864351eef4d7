"""All that is known of springs, as arrays of one row a spring. NumPy only."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sandbox.scene.lattice import FloatArray, IntArray
from sandbox.scene.model import Material


@dataclass(frozen=True)
class Behaviour:
    """What some springs do beyond pulling and pushing; springs that behave alike share a law."""

    tension_only: bool
    """They never push."""
    yields: bool
    """Their rest length flows."""
    tears: bool
    """They break."""


@dataclass(frozen=True)
class SpringSet:
    """S springs."""

    ends: IntArray
    """Pairs of particles, shape (S, 2)."""
    rest_lengths: FloatArray
    """[m], shape (S,)."""
    stiffness: FloatArray
    """[N/m], shape (S,)."""
    damping: FloatArray
    """[N s/m], shape (S,)."""
    yield_strain: FloatArray
    """Elastic strain beyond which the rest length flows [1], infinite where it never does, shape (S,)."""
    creep: FloatArray
    """Rate of that flow [1/s], infinite where it is immediate, shape (S,)."""
    max_plastic_strain: FloatArray
    """Most change of the rest length over the original [1], shape (S,)."""
    break_strain: FloatArray
    """Strain of stretch beyond which a spring tears [1], infinite where it never does, shape (S,)."""
    tension_only: NDArray[np.bool_]
    """True where a spring never pushes, shape (S,)."""
    body: IntArray
    """Body of every spring, shape (S,); those of attachment number a have body_count + a."""

    def __len__(self) -> int:
        return len(self.ends)

    @classmethod
    def of_body(
        cls,
        material: Material,
        ends: IntArray,
        rest_lengths: FloatArray,
        stiffness: FloatArray,
        damping: FloatArray,
    ) -> "SpringSet":
        """Springs of one material."""

        def everywhere(value: float | None) -> FloatArray:
            return np.full(len(ends), np.inf if value is None else value)

        return cls(
            ends=ends,
            rest_lengths=rest_lengths,
            stiffness=stiffness,
            damping=damping,
            yield_strain=everywhere(material.yield_strain),
            creep=everywhere(material.creep),
            max_plastic_strain=everywhere(material.max_plastic_strain),
            break_strain=everywhere(material.break_strain),
            tension_only=np.full(len(ends), material.tension_only),
            body=np.zeros(len(ends), dtype=np.int32),
        )

    @classmethod
    def joined(cls, sets: Sequence["SpringSet"]) -> "SpringSet":
        """One set after the other."""
        return cls(**{f.name: np.concatenate([getattr(one, f.name) for one in sets]) for f in fields(cls)})

    def shifted(self, first: int, body: int) -> "SpringSet":
        """The same springs of body number ``body``, whose particles begin at ``first``."""
        ends = (self.ends + first).astype(np.int32)
        return replace(self, ends=ends, body=np.full(len(self), body, dtype=np.int32))

    def renumbered(self, internal: NDArray[np.int64]) -> "SpringSet":
        """The same springs with particles by new numbers, shape (N,)."""
        return replace(self, ends=internal[self.ends].astype(np.int32).reshape(-1, 2))

    def chosen(self, which: NDArray[Any]) -> "SpringSet":
        """Some of the springs, by mask or index."""
        return SpringSet(**{f.name: getattr(self, f.name)[which] for f in fields(self)})

    @property
    def tears(self) -> bool:
        """True where any spring can tear."""
        return bool(np.isfinite(self.break_strain).any())

    def behaviours(self) -> Iterator[tuple[Behaviour, NDArray[np.int64]]]:
        """Every kind of behaviour that there is, plain springs first, and the springs that have it."""
        code = 4 * self.tension_only + 2 * np.isfinite(self.yield_strain) + np.isfinite(self.break_strain)
        for kind in np.unique(code):
            yield Behaviour(bool(kind & 4), bool(kind & 2), bool(kind & 1)), np.nonzero(code == kind)[0]
