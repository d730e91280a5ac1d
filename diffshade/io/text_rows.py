"""Text files of one record a line, read strictly: every complaint names the file and the line."""

from pathlib import Path

import numpy as np
from jaxtyping import Float

from diffshade.errors import BadInput
from diffshade.io.contents import read_text

__all__ = ["direction", "lines", "numbers", "rows"]


def lines(path: Path) -> list[tuple[int, str]]:
    """The lines of a text file that are not blank, stripped, each with its number from 1.

    Any line ending and a byte order mark are understood. Raises `BadInput` for what cannot be read
    as UTF-8 text.
    """
    stripped = (
        (number, line.strip()) for number, line in enumerate(read_text(path).splitlines(), 1)
    )
    return [(number, line) for number, line in stripped if line]


def numbers(tokens: list[str], where: str) -> Float[np.ndarray, "N"]:
    """Finite numbers from words; `where` names file and line."""
    try:
        values = np.array([float(token) for token in tokens])
    except ValueError:
        raise BadInput(f"{where}: {' '.join(tokens)!r} are not numbers; correct the line") from None
    if not np.isfinite(values).all():
        raise BadInput(f"{where}: {' '.join(tokens)!r} holds NaN or infinity; correct the line")
    return values


def rows(path: Path, *columns: int) -> list[tuple[str, Float[np.ndarray, "N"]]]:
    """The rows of a table of numbers, and where each stands; `columns`: allowed counts."""
    found = []
    for number, line in lines(path):
        where, tokens = f"{path}, line {number}", line.split()
        if len(tokens) not in columns:
            wanted = " or ".join(map(str, columns))
            raise BadInput(
                f"{where}: {len(tokens)} numbers where {wanted} belong; correct the line"
            )
        found.append((where, numbers(tokens, where)))
    return found


def direction(values: Float[np.ndarray, "3"], where: str) -> Float[np.ndarray, "3"]:
    """The unit vector of a light's direction; one too short to have a direction is refused."""
    largest = float(np.abs(values).max())
    if np.linalg.norm(values / max(largest, 1.0)) < 1e-6:
        raise BadInput(
            f"{where}: the light's direction has length {np.linalg.norm(values):.3g}, so it points"
            " nowhere; give the direction from the surface to the light"
        )
    scaled = values / largest  # whose squares are finite, whatever the length
    return scaled / np.linalg.norm(scaled)
