"""`diffshade fit` of several captures, or of every n-th of them: one after the other, each on its own."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from diffshade.commands.console import WrongUsage, note, said, show
from diffshade.errors import BadInput
from diffshade.progress import bar, telling

__all__ = ["Shard", "fit_batch"]

SCHEMA = "diffshade.fits/1"

Shard = tuple[int, int]
"""The i-th of n shares, counted from 1."""


def fit_batch(
    paths: Sequence[Path],
    *,
    shard: Shard = (1, 1),
    out: Path | None,
    as_json: bool,
    **options: Any,
) -> int:
    """Fit every n-th capture from the i-th on, each into a folder of its name below `out`.

    What is wrong with one is noted, and the others are fitted all the same. Returns the worst exit
    status of all.
    """
    from diffshade.commands.fit import fit_into

    share, shares = shard
    names = _names(paths)
    fits: list[dict[str, Any]] = []
    chosen = list(zip(paths, names, strict=True))[share - 1 :: shares]
    with bar("fitting captures") as progress:
        for path, name in telling(chosen, len(chosen), progress):
            entry: dict[str, Any] = {"capture": str(path), "name": name, "error": None, "fit": None}
            try:
                fitted, report = fit_into(None if out is None else out / name, path, **options)
                entry |= {"status": fitted.status, "fit": fitted.document}
                if not as_json:
                    said(f"{path}\n\n{report}\n", sys.stdout)
            except BadInput as error:
                note(f"{error}")
                entry |= {"status": 3, "error": str(error)}
            fits.append(entry)
    status = max((entry["status"] for entry in fits), default=0)
    told = Counter(entry["status"] for entry in fits)
    summary = f"{len(fits)} of {len(paths)} captures: {told[0]} fitted"
    others = ((1, "not converged"), (3, "could not be used"))
    summary += "".join(f", {told[code]} {what}" for code, what in others if told[code])
    document = {"schema": SCHEMA, "shard": list(shard), "captures": len(paths), "fits": fits}
    show(document, summary, as_json=as_json)
    return status


def _names(paths: Sequence[Path]) -> list[str]:
    """Of each capture: that of its folder or file, or of the folder that a capture.toml lies in."""
    whole = [path.resolve() for path in paths]
    names = [
        path.parent.name
        if path.name == "capture.toml"
        else path.name
        if path.is_dir()
        else path.stem
        for path in whole
    ]
    for name, count in Counter(names).items():
        if count > 1:
            same = " and ".join(str(p) for p, n in zip(paths, names, strict=True) if n == name)
            raise WrongUsage(f"{same} have one name, {name}: rename them, or fit them apart")
    return names
