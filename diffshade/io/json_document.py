"""JSON files read strictly, as TOML files are."""

import json
from pathlib import Path

from diffshade.errors import BadInput
from diffshade.io.contents import read_text
from diffshade.io.toml_document import Table

__all__ = ["read_json"]


def read_json(path: Path, wanted: str) -> Table:
    """The object of a JSON file; raises `BadInput`, asking for what is `wanted`, for anything else."""
    try:
        document = json.loads(read_text(path))
    except BadInput:
        raise
    except (ValueError, RecursionError) as error:
        raise BadInput(f"{path}: is not JSON ({error}); give {wanted}") from None
    if not isinstance(document, dict):
        raise BadInput(f"{path}: holds no JSON object; give {wanted}")
    return Table(path, "", document)
