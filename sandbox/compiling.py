"""A quicker start: Taichi's reading of kernel sources without its waste.

Taichi 1.7.4 reads the source of a function again for every call of it inside a kernel, wraps its
lines with textwrap, and formats a picture of the source line for every node of its syntax tree. That
is most of the time between a command and its first picture once kernels come from the offline cache
(see benchmarks/startup.py). What stands in for it here gives the same kernels; only the text of
Taichi's own error messages is shorter.
"""

import textwrap
from functools import cache
from types import SimpleNamespace
from typing import Any

from taichi.lang import kernel_impl
from taichi.lang.ast.ast_transformer_utils import ASTTransformerContext


def _position(context: Any, node: Any) -> str:
    return f'File "{context.file}", line {node.lineno + context.lineno_offset}, in {context.func.func.__name__}:\n'


_REPLACEMENTS: list[tuple[Any, str, Any]] = [
    (ASTTransformerContext, "get_pos_info", _position),
    (
        kernel_impl,
        "textwrap",
        SimpleNamespace(fill=lambda line, **_: line.rstrip().expandtabs(4), dedent=textwrap.dedent),
    ),
    (kernel_impl, "getsourcelines", cache(getattr(kernel_impl, "getsourcelines", None) or (lambda _: ([], 0)))),
]


def quicken() -> None:
    """Replace the slow parts, once. A Taichi that is built otherwise is left as it is."""
    if all(hasattr(owner, name) for owner, name, _ in _REPLACEMENTS):
        for owner, name, replacement in _REPLACEMENTS:
            setattr(owner, name, replacement)
