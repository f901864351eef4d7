"""A picture of a simulation as it is now, for notebooks."""

from sandbox.errors import SceneError
from sandbox.observed import Observed
from sandbox.output.inline import InlinePicture
from sandbox.particle_values import ParticleValues
from sandbox.render import create_renderer
from sandbox.scene.model import ColorBy, Render


def picture_of(simulation: Observed, size: tuple[int, int] | None = None) -> InlinePicture:
    """The state now as ``sandbox run`` would draw it, ``size`` pixels wide and high; by default as the scene says.

    Raises SceneError where the size is not two even numbers from 16 to 7680.
    """
    state = simulation.state
    render = simulation.scene.render
    if size is not None:
        try:
            render = Render.model_validate({**render.model_dump(), "size": tuple(size)})
        except (ValueError, TypeError):
            raise SceneError(f"size {size}: must be two even numbers from 16 to 7680, such as (640, 360)") from None
    renderer = create_renderer("taichi", simulation.assembly.appearance, render)
    values = None
    if render.color is not ColorBy.BODY:
        shown = ParticleValues(simulation, render.color)
        values = shown.update()
        if render.color_max is None:
            renderer.set_color_max(shown.expected_largest())
    try:
        return InlinePicture(renderer.draw(state.x, state.slot, values, time=simulation.time, torn=simulation.torn))
    finally:
        renderer.close()
