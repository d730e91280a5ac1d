"""Values as TOML has them, and the names that laws of attenuation have there."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from diffshade.light.attenuation import AbstractAttenuation

__all__ = ["law_kinds", "table_text", "value_text"]


def value_text(value: Any) -> str:
    """A value of TOML: strings and numbers are as in JSON, but for DEL.

    >>> value_text({"kind": "parallel", "direction": [0.0, 0.6, 0.8]})
    '{ kind = "parallel", direction = [0.0, 0.6, 0.8] }'
    """
    if isinstance(value, Mapping):
        return table_text({key: value_text(entry) for key, entry in value.items()})
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(value_text, value))}]"
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def table_text(entries: Mapping[str, str]) -> str:
    """A table in one line, of values that are text already."""
    return f"{{ {', '.join(f'{key} = {text}' for key, text in entries.items())} }}"


def law_kinds() -> dict[type[AbstractAttenuation], str]:
    """The `kind` of each law; one that is windowed has a `reach` beside that of its own law."""
    from diffshade.light import attenuation as laws

    return {
        laws.QuadraticAttenuation: "quadratic",
        laws.LinearAttenuation: "linear",
        laws.InverseSquare: "inverse_square",
        laws.ExponentialAttenuation: "exponential",
    }
