"""Renderers behind one protocol. Importing this package does not import Taichi."""

from enum import StrEnum

from sandbox.render.null import NullRenderer
from sandbox.render.protocol import Picture, Renderer
from sandbox.scene.appearance import Appearance
from sandbox.scene.model import Render

__all__ = ["NullRenderer", "Picture", "Renderer", "RendererName", "create_renderer"]


class RendererName(StrEnum):
    """Renderers, by the names that the command line takes."""

    TAICHI = "taichi"
    GGUI = "ggui"
    NONE = "none"


def create_renderer(name: str, appearance: Appearance, render: Render) -> Renderer:
    """Create the renderer called `name`; Taichi must have been started for all but `none`.

    Raises ValueError when there is no such renderer.
    """
    match RendererName(name):
        case RendererName.NONE:
            return NullRenderer(render.size)
        case RendererName.TAICHI:
            from sandbox.render.software import SoftwareRenderer

            return SoftwareRenderer(appearance, render)
        case RendererName.GGUI:
            from sandbox.render.ggui.renderer import open_ggui

            return open_ggui(appearance, render)
