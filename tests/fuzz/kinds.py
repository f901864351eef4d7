"""All kinds of inputs, by name."""

import importlib.util

from tests.fuzz.action_files import ACTIONS
from tests.fuzz.checkpoints import CHECKPOINTS
from tests.fuzz.meshes import MESHES
from tests.fuzz.messages import MESSAGES
from tests.fuzz.pages import PAGES
from tests.fuzz.runs import RUNS
from tests.fuzz.scene_files import OVERRIDES, SCENES

_NEEDS_WEB = (PAGES,) if importlib.util.find_spec("viser") else ()
KINDS = {kind.name: kind for kind in (SCENES, OVERRIDES, ACTIONS, CHECKPOINTS, MESHES, MESSAGES, *_NEEDS_WEB, RUNS)}
