"""Time integration schemes as data. None of them knows a force."""

from dataclasses import dataclass

from sandbox.scene.model import IntegratorName


@dataclass(frozen=True)
class SplittingScheme:
    """A step of length h as kick (``lead`` h), drift (h), kick ((1 - ``lead``) h).

    Adjoining kicks of consecutive steps happen at the same positions and are done as one, so a step
    costs one force evaluation whatever ``lead`` is.
    """

    order: int
    """Order of accuracy."""
    lead: float
    """Fraction of the kick that comes before the drift."""
    damping_weight: float
    """Stable while h^2 K + ``damping_weight`` h C <= 4 M, the scheme's limit with damping matrix C."""
    predicts_velocity: bool
    """True where velocity-dependent forces need the velocity predicted to the time of the positions."""


# Symplectic Euler: with one frequency, h^2 w^2 + 4 zeta w h <= 4, that is w h <= 2 (sqrt(1 + zeta^2) - zeta).
#
# Velocity Verlet knows v half a step before x when forces are due. Forces that depend on velocity are
# given v + (h / 2) a with the last acceleration, exact to second order (Groot and Warren 1997, with
# lambda = 1), which keeps the scheme of order 2 with damping. Setting x, v, and the prediction to
# alternate in sign gives the limit h^2 w^2 + 8 zeta w h <= 4.
SCHEMES: dict[IntegratorName, SplittingScheme] = {
    IntegratorName.SYMPLECTIC_EULER: SplittingScheme(order=1, lead=1.0, damping_weight=2.0, predicts_velocity=False),
    IntegratorName.VELOCITY_VERLET: SplittingScheme(order=2, lead=0.5, damping_weight=4.0, predicts_velocity=True),
}
