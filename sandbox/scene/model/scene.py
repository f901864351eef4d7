"""The scene itself, how it is solved and what is looked at."""

from typing import Annotated, Literal

from pydantic import Field

from sandbox.scene.model.actions import Action
from sandbox.scene.model.base import Flag, Index, Model, NonNegative, Positive, Vector
from sandbox.scene.model.bodies import Attachment, Body
from sandbox.scene.model.colliders import Collider
from sandbox.scene.model.render import Render
from sandbox.scene.model.solver import Solver
from sandbox.scene.model.surroundings import Contact, Wind


class Diagnostics(Model):
    """Bounds past which a run counts as diverged, and what is booked beside the energies."""

    ledger: Flag = Field(False, description="book the work of every part that adds or takes energy")

    max_strain: Positive = Field(10.0, description="largest spring strain |r - L| / L before the run stops [1]")
    max_speed: Positive = Field(1e5, description="largest particle speed before the run stops [m/s]")


class Interaction(Model):
    """Room for what is done to the bodies live; without it a scene is closed."""

    grips: Annotated[Index, Field(le=1000)] = Field(4, description="hands")
    pushes: Annotated[Index, Field(le=1000)] = Field(4, description="pushes at a time")
    shakes: Annotated[Index, Field(le=1000)] = Field(1, description="shakes at a time")


class Scene(Model):
    """A soft-body scene in SI units; 2D bodies are 1 m thick."""

    title: str = Field("", description="one line, for lists and captions")
    description: str = Field("", description="what to look for")
    dimension: Literal[2, 3] = Field(description="2 or 3")
    duration: Positive = Field(3.0, description="simulated time [s]")
    gravity: Vector | None = Field(None, description="gravitational acceleration [m/s^2]; none by default")
    drag: NonNegative = Field(0.0, description="drag rate gamma [1/s]: force -gamma m v on every particle")
    solver: Solver = Solver()
    diagnostics: Diagnostics = Diagnostics()
    render: Render = Render()
    bodies: tuple[Body, ...] = Field(min_length=1, description="the soft bodies")
    colliders: tuple[Collider, ...] = Field((), description="solid things that bodies meet")
    attachments: tuple[Attachment, ...] = Field((), description="what holds bodies together, or to colliders")
    wind: Wind | None = Field(None, description="moving air; none by default")
    contact: Contact = Contact()
    actions: tuple[Action, ...] = Field((), description="what is done to the bodies, and when")
    interaction: Interaction | None = Field(None, description="room for what is done live; none by default")
