"""How a scene is solved."""

from enum import StrEnum
from typing import Annotated, Literal

from pydantic import Field

from sandbox.scene.model.base import Model, Positive, Real


class IntegratorName(StrEnum):
    """Time integration schemes, by the field's names."""

    EXPLICIT_EULER = "explicit_euler"
    SYMPLECTIC_EULER = "symplectic_euler"
    VELOCITY_VERLET = "velocity_verlet"
    MIDPOINT = "midpoint"
    HEUN = "heun"
    RK4 = "rk4"
    IMPLICIT_EULER = "implicit_euler"
    IMPLICIT_MIDPOINT = "implicit_midpoint"
    XPBD = "xpbd"
    VBD = "vbd"


class Precision(StrEnum):
    """Floating-point format of every field and kernel."""

    F32 = "f32"
    F64 = "f64"


class Solver(Model):
    """How time is stepped."""

    integrator: IntegratorName = Field(IntegratorName.SYMPLECTIC_EULER, description="time integration scheme")
    dt: Positive | Literal["auto"] = Field(
        "auto", description='largest step [s], or "auto": `safety` times the stability limit of the scheme'
    )
    safety: Annotated[Real, Field(gt=0, le=1)] = Field(
        0.8, description='fraction of the stability limit that dt = "auto" takes'
    )
    precision: Precision = Field(Precision.F32, description="floating-point format of every field and kernel")
    iterations: Annotated[int, Field(ge=1, le=100_000)] | None = Field(
        None,
        description="most Newton iterations a step of the implicit schemes (default 20); iterations a step of xpbd, "
        "sweeps a step of vbd (default 10)",
    )
    linear_iterations: Annotated[int, Field(ge=1, le=100_000)] = Field(
        400, description="most conjugate gradient iterations a Newton iteration"
    )
    tolerance: Annotated[Positive, Field(lt=1)] = Field(
        1e-4,
        description="residual at which the implicit schemes are done with a step: its size over that of all impulses "
        "of the step, both weighted by M^-1/2 [1]; never below what rounding leaves",
    )
    chebyshev: Annotated[Real, Field(ge=0, lt=1)] = Field(
        0.0, description="spectral radius that vbd's Chebyshev acceleration reckons with [1]; 0 is without"
    )
    accuracy: Annotated[Real, Field(gt=0, le=1)] = Field(
        0.15,
        description='relative error of the slowest deformation over its period that dt = "auto" of an implicit scheme '
        "aims at [1]",
    )
    adapt: Literal["rescue"] | None = Field(
        None, description='"rescue": a run that goes wrong returns to the last good picture and halves dt'
    )
    horizon: Positive = Field(
        10.0,
        description="time in which explicit_euler, midpoint and heun, whose undamped vibrations grow, may let one "
        'grow tenfold with dt = "auto" [s]',
    )
    most_halvings: Annotated[int, Field(ge=1, le=40)] = Field(
        8, description="how often a rescue may halve dt before the run stops after all"
    )
