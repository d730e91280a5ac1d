"""The score over all hard scenes, in both precisions.

    PYTHONPATH=tests python -m stress.score [--large] [--only WORD ...]

Prints what came of each, and how many came out as they are due; exit status 1 says that one did not.
`--large` tries those of 8,192 x 8,192 pixels as well, for which 16 GiB of memory are enough.
"""

import argparse
import faulthandler
import sys
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import jax
from stress import pictures, recoveries
from stress.hard_scene import LIMIT, HardScene, Verdict, tried

__all__ = ["Result", "results", "scenes"]


class Result(NamedTuple):
    """A scene to render or to fit, in a precision, and the verdict on it."""

    task: str
    scene: HardScene
    bits: int
    verdict: Verdict

    @property
    def passed(self) -> bool:
        return self.verdict.kind == self.scene.due


def scenes() -> list[tuple[str, HardScene]]:
    """All of them: to render and to fit."""
    tasks = ("render", pictures.SCENES), ("fit", recoveries.SCENES)
    return [(task, scene) for task, many in tasks for scene in many]


def results(*, large: bool = False, words: Sequence[str] = ("",)) -> Iterator[Result]:
    """Those whose names hold one of the words."""
    for bits in (32, 64):
        with jax.enable_x64(bits == 64):
            for task, scene in scenes():
                if (scene.large and not large) or not any(word in scene.name for word in words):
                    continue
                # A scene that hangs ends the command, which then says where it stood.
                faulthandler.dump_traceback_later(10 * LIMIT, exit=True)
                yield Result(task, scene, bits, tried(scene))
                faulthandler.cancel_dump_traceback_later()


def main() -> int:
    """Try them, and print a table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--large", action="store_true", help="those of gigabytes as well")
    parser.add_argument("--only", nargs="*", default=[""], metavar="WORD")
    options = parser.parse_args()
    jax.config.update("jax_numpy_dtype_promotion", "strict")
    jax.config.update("jax_numpy_rank_promotion", "raise")
    print("| | scene | bits | | s | |\n|---|---|---|---|---|---|")
    found = []
    for result in results(large=options.large, words=options.only):
        scene, (kind, detail, seconds) = result.scene, result.verdict
        said = kind if result.passed else f"{kind.upper()}, not {scene.due}"
        row = result.task, scene.name, result.bits, said, f"{seconds:.1f}", detail
        print("|", " | ".join(map(str, row)), "|", flush=True)
        found.append(result.passed)
    print(f"\n{sum(found)} of {len(found)} as they are due")
    return 0 if all(found) else 1


if __name__ == "__main__":
    sys.exit(main())
