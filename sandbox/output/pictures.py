"""Who takes pictures, one after the other."""

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

Picture = NDArray[np.uint8]
Memory = Mapping[str, NDArray[Any]]


class PictureWriter(Protocol):
    """Takes pictures of shape (height, width, 3), one after the other."""

    @property
    def between_groups(self) -> bool:
        """True where :meth:`memory` is small."""
        ...

    def write(self, picture: Picture) -> None: ...

    def close(self, indexes: bool = True) -> None:
        """Finish the file, and prepare an index for it; a writer can still go on with it."""
        ...

    def settle(self) -> None:
        """Put the index into the file, with which nothing can go on any more."""
        ...

    def memory(self) -> Memory:
        """What a writer of the same folder needs to go on from here, see :func:`open_writer`; not after close."""
        ...
