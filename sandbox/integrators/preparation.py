"""What parts must know of the whole state before forces are gathered: volumes, winds, poses."""

from typing import Any

import taichi as ti

from sandbox.parts import Parts


@ti.data_oriented
class Preparation:
    """Runs what the parts prepare. Its loops run in parallel where the calling kernel calls it outermost."""

    def __init__(self, parts: Parts) -> None:
        self.laws = _preparing(parts.laws)
        self.all = _preparing([*parts.movers, *parts.laws])

    @ti.func
    def begin(self, slot, time, dt):
        """At the beginning of a step of ``dt`` [s] at ``time`` [s]: what moves and flows does so for the step."""
        for part in ti.static(self.all):
            self._prepare(part, slot, time, dt)

    @ti.func
    def again(self, slot, time):
        """For forces at another state within a step: nothing flows."""
        for law in ti.static(self.laws):
            self._prepare(law, slot, time, 0.0)

    @ti.func
    def _prepare(self, part: ti.template(), slot, time, dt):
        if ti.static(part.prepare_count > 0):
            for k in range(part.prepare_count):
                part.prepare_at(k, slot, time, dt)
        ti.loop_config(serialize=True)
        for _ in range(1):
            part.prepare_end(slot, time, dt)


def _preparing(parts: list[Any]) -> list[Any]:
    return [part for part in parts if hasattr(part, "prepare_end")]
